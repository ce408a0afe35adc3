"""The loss of a view's surfaces: normals within it, and what a neighbour says of them."""

import numpy as np
import torch

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.training.config import GeometryConfig
from readygo.services.reconstructor.training.neighbours import Side, neighbour_losses
from readygo.services.reconstructor.training.planes import edge_weights, normal_loss, plane_depth, rays_of

Tensor = torch.Tensor
GREY = (0.299, 0.587, 0.114)


def side_of(
    planes: Tensor, rgb: Tensor, K_px: Float64Array, T_world_camera: Float64Array, mask: Tensor | None = None
) -> Side:
    """A view as it is compared with others.

    Args:
        planes: Blended `plane_features`, shape (H, W, 4).
        rgb: The photo, on the same device, shape (3, H, W).
        K_px: Shape (3, 3).
        T_world_camera: Shape (4, 4).
        mask: True where the photo counts, shape (H, W); None where all of it does.
    """
    T, K, grey = (
        torch.tensor(np.asarray(array, dtype=np.float32), device=planes.device)
        for array in (T_world_camera, K_px, GREY)
    )
    rays_W = rays_of(K_px, (rgb.shape[1], rgb.shape[2]), device=planes.device) @ T[:3, :3].T
    return Side(planes=planes, grey=torch.tensordot(grey, rgb, 1), K_px=K, T_world_camera=T, rays_W=rays_W, mask=mask)


def normals_within(side: Side, alpha: Tensor, rgb: Tensor, config: GeometryConfig) -> Tensor:
    """Weighted loss of the normals of a view, whose photo is `rgb` (3, H, W)."""
    weights = edge_weights(rgb)
    if side.mask is not None:
        weights = weights * side.mask
    return config.normal * normal_loss(side.planes, alpha, side.rays_W, weights)


def off_measured(side: Side, measured_m: Tensor, config: GeometryConfig) -> Tensor:
    """Weighted mean of |depth / measured depth - 1|.

    Args:
        side: The view.
        measured_m: Depths that a device measured, 0 where it did not, shape (H, W).
        config: Weights of the losses.
    """
    depth_m, known = plane_depth(side.planes, side.rays_W)
    known = known & (measured_m > 0)
    if side.mask is not None:
        known = known & side.mask
    off = (depth_m / torch.where(known, measured_m, 1.0) - 1.0).abs() * known
    return config.depth * off.sum() / known.sum().clamp(min=1)


def between(side: Side, other: Side, config: GeometryConfig, rng: np.random.Generator) -> Tensor:
    """Weighted losses of a view and its neighbour; `rng` chooses patches."""
    far_px, differs = neighbour_losses(side, other, noise_px=config.noise_px, patches_max=config.patches_max, rng=rng)
    return config.consistent * far_px + config.ncc * differs
