"""A scene as Gaussians for a browser: reduced in number, and split at the ceiling for views from above."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.scenes import Scene
from readygo.common.scenes.top_view import CEILING_M

SPLATS_MAX = 600_000
"""Largest number of Gaussians for a browser, 32 bytes each; those that cover most are retained."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Splats:
    """N Gaussians in the format of viewers."""

    centers_m: Float32Array
    """Centres [m], shape (N, 3)."""
    covariances_m2: Float32Array
    """Covariances [m2], shape (N, 3, 3)."""
    rgb: Float32Array
    """Direction-independent colours, 0..1, shape (N, 3)."""
    opacities: Float32Array
    """Opacities, 0..1, shape (N, 1)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DollsHouse:
    """A scene in two parts."""

    open: Splats
    """Gaussians lower than `CEILING_M` above the local floor."""
    roof: Splats
    """Gaussians higher than that."""
    center_m: Float64Array
    """Centre of the scene's floor [m], shape (3,)."""
    radius_m: float
    """Extent of the scene from its centre [m]."""


def dolls_house(scene: Scene) -> DollsHouse:
    """A scene for a browser.

    Args:
        scene: Scene bundle, whose Gaussians are read.
    """
    cloud = most_covering(scene.cloud, SPLATS_MAX)
    above = _above_floor(scene, cloud.means_m) > CEILING_M
    frame, occupied = scene.maps.robot.frame, scene.maps.robot.occupied
    rows, columns = np.nonzero(~occupied)
    low = np.array([columns.min(), rows.min()]) if len(rows) else np.zeros(2)
    high = np.array([columns.max(), rows.max()]) + 1.0 if len(rows) else np.array(occupied.shape[::-1], float)
    origin = np.array([frame.origin_x_m, frame.origin_y_m])
    middle, size = origin + 0.5 * (low + high) * frame.resolution_m, (high - low) * frame.resolution_m
    return DollsHouse(
        open=splats_of(cloud.select(~above)),
        roof=splats_of(cloud.select(above)),
        center_m=np.array([*middle, float(np.median(scene.maps.floor.height_m))]),
        radius_m=float(0.5 * np.hypot(*size)),
    )


def most_covering(cloud: GaussianCloud, count_max: int) -> GaussianCloud:
    """The Gaussians that hide most: by opacity and by the area of their largest face."""
    if len(cloud) <= count_max:
        return cloud
    scales_m = np.sort(cloud.scales_m, axis=1)
    cover = cloud.opacities * scales_m[:, 1] * scales_m[:, 2]
    return cloud.select(np.argpartition(-cover, count_max)[:count_max])


def splats_of(cloud: GaussianCloud) -> Splats:
    """Gaussians in the format of viewers, without direction-dependent colour."""
    w, x, y, z = (cloud.quats_wxyz / np.linalg.norm(cloud.quats_wxyz, axis=1, keepdims=True)).T
    rotations = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=1,
    ).reshape(-1, 3, 3)
    axes_m = rotations * cloud.scales_m[:, None, :]
    return Splats(
        centers_m=cloud.means_m,
        covariances_m2=axes_m @ axes_m.transpose(0, 2, 1),
        rgb=np.clip(0.5 + SH_C0 * cloud.sh[:, 0], 0.0, 1.0).astype(np.float32),
        opacities=cloud.opacities[:, None],
    )


def _above_floor(scene: Scene, points_m: Float32Array) -> Float32Array:
    """Height above the local floor [m], shape (N,)."""
    floor = scene.maps.floor
    rows, columns = floor.height_m.shape
    frame = floor.frame
    j = np.clip((points_m[:, 0] - frame.origin_x_m) / frame.resolution_m, 0, columns - 1).astype(np.int64)
    i = np.clip((points_m[:, 1] - frame.origin_y_m) / frame.resolution_m, 0, rows - 1).astype(np.int64)
    heights: Float32Array = points_m[:, 2] - floor.height_m[i, j]
    return heights
