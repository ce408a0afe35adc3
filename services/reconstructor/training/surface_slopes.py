"""What `surfaces` says of a view and its neighbour, with derivatives by their planes, on the CPU.

The losses are those of `surfaces`, which torch derives on any device; here they have dedicated kernels.
"""

from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Float64Array
from readygo.services.reconstructor.training.config import GeometryConfig
from readygo.services.reconstructor.training.neighbours import NCC_MAX, NEAR_M, PATCH_PX
from readygo.services.reconstructor.training.photos import Photo
from readygo.services.reconstructor.training.planes import FACING_MIN, edge_weights
from readygo.services.reconstructor.training.surface_kernels import (
    CAMERA,
    add_depth_slopes,
    normal_slopes,
    patch_slopes,
    plane_depths,
    return_slopes,
)
from readygo.services.reconstructor.training.surfaces import GREY


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneView:
    """A view with its planes."""

    photo: Photo
    planes: Float32Array
    """Blended `plane_features`, shape (4, H, W)."""


class _Slopes:
    """Depths of a view, and what is wanted of its planes."""

    def __init__(self, view: PlaneView) -> None:
        self.planes, self.camera = view.planes, camera_numbers(view.photo)
        self.depth_m = np.empty(view.planes.shape[1:], dtype=np.float32)
        plane_depths(self.planes, self.camera, FACING_MIN, self.depth_m)
        self.by_planes, self.by_depth = np.zeros_like(view.planes), np.zeros_like(self.depth_m)

    def whole(self) -> Float32Array:
        """Derivatives by the planes, those through depths included, shape (4, H, W)."""
        add_depth_slopes(self.planes, self.camera, self.depth_m, self.by_depth, self.by_planes)
        return self.by_planes


def camera_numbers(photo: Photo) -> Float64Array:
    """A photo's camera as kernels take it."""
    K, T = photo.K_px, photo.T_world_camera
    numbers: Float64Array = np.empty(CAMERA)
    numbers[:4], numbers[16:] = (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), (1.0 / K[0, 0], 1.0 / K[1, 1])
    numbers[4:13], numbers[13:16] = T[:3, :3].reshape(-1), T[:3, 3]
    return numbers


def surface_slopes(
    one: PlaneView, other: PlaneView | None, alpha: Float32Array, config: GeometryConfig, rng: np.random.Generator
) -> tuple[float, Float32Array, Float32Array | None]:
    """The loss, and its derivatives by the planes of a view and of its neighbour.

    Args:
        one: The view.
        other: Its neighbour.
        alpha: Of the view, shape (H, W).
        config: Weights of the losses.
        rng: Chooses patches.
    """
    weights = edge_weights(torch.from_numpy(one.photo.rgb)).numpy()
    if one.photo.mask is not None:
        weights = weights * one.photo.mask
    here = _Slopes(one)
    scale = config.normal / here.depth_m.size
    loss = normal_slopes(here.planes, alpha, weights, here.camera, here.depth_m, scale, here.by_depth, here.by_planes)
    if one.photo.depth_m is not None:
        loss += _off_measured(here, one, one.photo.depth_m, config)
    if other is None:
        return loss, here.whole(), None
    there = _Slopes(other)
    loss += _between(here, there, one, other, config, rng)
    return loss, here.whole(), there.whole()


def _off_measured(here: _Slopes, one: PlaneView, measured_m: Float32Array, config: GeometryConfig) -> float:
    """Weighted mean of |depth / measured depth - 1|; its derivative, sign / measured depth, is added."""
    known = (measured_m > 0) & (_counted(here, one) > 0)
    count = int(known.sum())
    if not count:
        return 0.0
    off = here.depth_m[known] / measured_m[known] - 1.0
    here.by_depth[known] += np.float32(config.depth / count) * np.sign(off) / measured_m[known]
    return float(config.depth / count * np.abs(off).sum())


def _between(
    here: _Slopes, there: _Slopes, one: PlaneView, other: PlaneView, config: GeometryConfig, rng: np.random.Generator
) -> float:
    """What the neighbour says; derivatives are added to both."""
    away_px, by_depth = np.empty_like(here.depth_m), np.zeros_like(here.depth_m)
    count, total = return_slopes(
        _counted(here, one), _counted(there, other), here.camera, there.camera, NEAR_M, config.noise_px, away_px,
        by_depth, there.by_depth,
    )  # fmt: skip
    if not count:
        return 0.0
    scale = np.float32(config.consistent / count)
    here.by_depth += scale * by_depth
    there.by_depth *= scale
    rows = np.flatnonzero(np.isfinite(away_px).reshape(-1))
    if len(rows) > config.patches_max:
        rows = np.sort(rng.choice(rows, config.patches_max, replace=False))
    slopes, work = np.empty((len(rows), 4)), np.empty((3, PATCH_PX * PATCH_PX))
    patches, differences = patch_slopes(
        here.planes, _grey(one.photo), _grey(other.photo), here.camera, there.camera, rows, away_px, PATCH_PX, NCC_MAX,
        work, slopes,
    )  # fmt: skip
    if not patches:
        return float(config.consistent * total / count)
    here.by_planes.reshape(4, -1)[:, rows] += (config.ncc / patches * slopes.T).astype(np.float32)
    return float(config.consistent * total / count + config.ncc * differences / patches)


def _counted(slopes: _Slopes, view: PlaneView) -> Float32Array:
    """Depths of a view, 0 where its photo is ignored."""
    mask = view.photo.mask
    return slopes.depth_m if mask is None else slopes.depth_m * mask


def _grey(photo: Photo) -> Float32Array:
    grey: Float32Array = np.tensordot(np.array(GREY, dtype=np.float32), photo.rgb, 1)
    return grey
