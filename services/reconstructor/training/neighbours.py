"""Losses between two views of the same surface, and which views are compared.

Source: Chen et al., PGSR, 2024, section 4.2.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn.functional import grid_sample

from readygo.common.arrays import BoolArray, Float64Array
from readygo.services.reconstructor.training.planes import plane_depth

Tensor = torch.Tensor
NEAR_M = 0.1
"""Nearer points of a neighbour are not compared."""
PATCH_PX = 7
NCC_MAX = 0.9
"""Patches that differ more show something else."""
DISTANCE_M = 1.5
"""Neighbours are not farther from a view that has any within this distance [m] (PGSR)."""
_SPACINGS, _SPACING_QUANTILE, _DEPTHS = 2.0, 0.9, 0.5
"""A view without such neighbours looks for them within this many times the quantile of the cameras' spacing, and within
this many median depths, beyond which two images show too different sides of a surface."""


def choose_neighbours(
    T_world_camera: Float64Array, *, angle_max_deg: float, distance_m: tuple[float, float | Float64Array], count: int
) -> list[tuple[int, ...]]:
    """For each view the nearest others that look the same way.

    Args:
        T_world_camera: Shape (V, 4, 4).
        angle_max_deg: Between the optical axes.
        distance_m: Least and most distance between the cameras; the most for all views, or of each, shape (V,).
        count: At most so many.
    """
    distances, alike = _distances_m(T_world_camera, angle_max_deg)
    most_m = np.broadcast_to(np.asarray(distance_m[1]), len(distances))
    near = alike & (distances > distance_m[0]) & (distances < most_m[:, None])
    return [
        tuple(int(other) for other in sorted(np.flatnonzero(near[view]), key=lambda k: distances[view, k])[:count])
        for view in range(len(distances))
    ]


def neighbour_distances(
    T_world_camera: Float64Array, depth_m: float, *, angle_max_deg: float, distance_min_m: float
) -> Float64Array:
    """How far each view looks for neighbours, by how far the cameras are apart.

    Views with a neighbour within `DISTANCE_M` look that far. The others look as far as the cameras' spacing asks for:
    the distance from a camera to the nearest other one that looks the same way.

    Args:
        T_world_camera: Shape (V, 4, 4).
        depth_m: Median depth of what the views show [m].
        angle_max_deg: Between optical axes of views that look the same way.
        distance_min_m: Nearer cameras do not count.

    Returns:
        Shape (V,) [m].
    """
    distances, alike = _distances_m(T_world_camera, angle_max_deg)
    nearest_m = np.where(alike & (distances > distance_min_m), distances, np.inf).min(axis=1)
    known = nearest_m[np.isfinite(nearest_m)]
    spacing_m = float(np.quantile(known, _SPACING_QUANTILE)) if len(known) else 0.0
    reach_m = max(DISTANCE_M, min(_SPACINGS * spacing_m, _DEPTHS * depth_m))
    return np.where(nearest_m < DISTANCE_M, DISTANCE_M, reach_m)


def _distances_m(T_world_camera: Float64Array, angle_max_deg: float) -> tuple[Float64Array, BoolArray]:
    """Distances between cameras [m], and which look the same way and are not one and the same, shape (V, V)."""
    axes, places = T_world_camera[:, :3, 2], T_world_camera[:, :3, 3]
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    alike = axes @ axes.T > np.cos(np.deg2rad(angle_max_deg))
    np.fill_diagonal(alike, False)
    return distances, alike


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One of two views that are compared."""

    planes: Tensor
    """Blended `plane_features`, shape (H, W, 4)."""
    grey: Tensor
    """The photo, shape (H, W)."""
    K_px: Tensor
    T_world_camera: Tensor
    """Pose of the camera, shape (4, 4), of the same type as the planes."""
    rays_W: Tensor
    """Rays at depth 1 in the world's axes, shape (H, W, 3)."""
    mask: Tensor | None = None
    """True where the photo counts, shape (H, W); None where all of it does."""

    @property
    def R_WC(self) -> Tensor:
        """Rotation of the camera in the world, shape (3, 3)."""
        return self.T_world_camera[:3, :3]

    @property
    def p_WC(self) -> Tensor:
        """Position of the camera in the world [m], shape (3,)."""
        return self.T_world_camera[:3, 3]

    def depth(self) -> tuple[Tensor, Tensor]:
        """Depths [m], 1 where there is none or the photo does not count, shape (H, W); where there is one."""
        depth_m, known = plane_depth(self.planes, self.rays_W)
        if self.mask is None:
            return depth_m, known
        return torch.where(self.mask, depth_m, 1.0), known & self.mask

    def pixels(self, points_W: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels of points, shape (..., 2), and their depths; those behind the camera are anywhere."""
        p_C = (points_W - self.p_WC) @ self.R_WC
        depth_m = p_C[..., 2]
        p_px = (p_C / torch.where(depth_m > NEAR_M, depth_m, 1.0)[..., None]) @ self.K_px.T
        return p_px[..., :2], depth_m

    def sample_image(self, image: Tensor, p_px: Tensor) -> Tensor:
        """An image (H, W) between its pixels, shape (n, m) for pixels (n, m, 2)."""
        height, width = image.shape
        grid = 2.0 * p_px / p_px.new_tensor([width, height]) - 1.0
        return grid_sample(image[None, None], grid[None], align_corners=False, padding_mode="border")[0, 0]


def there_and_back(one: Side, other: Side, noise_px: float) -> tuple[Tensor, Tensor]:
    """How far pixels come back from where they began, by way of the other view's depth.

    Returns:
        Distances [px], shape (H, W); where they count: the point is in the other image and comes back within
        `noise_px`.
    """
    depth_m, known = one.depth()
    other_depth_m, other_known = other.depth()
    height, width = other_depth_m.shape
    p_px, z = other.pixels(one.p_WC + one.rays_W * depth_m[..., None])
    inside = (p_px >= 0).all(dim=-1) & (p_px[..., 0] <= width) & (p_px[..., 1] <= height) & (z > NEAR_M)
    seen_m = other.sample_image(other_depth_m, p_px)
    seen = other.sample_image(other_known.to(seen_m.dtype), p_px) > 0.99
    ray_O = torch.cat([p_px, torch.ones_like(p_px[..., :1])], dim=-1) @ torch.linalg.inv(other.K_px).T
    back_px, back_z = one.pixels(other.p_WC + (ray_O * seen_m[..., None]) @ other.R_WC.T)
    centres = (torch.arange(side, dtype=p_px.dtype, device=p_px.device) + 0.5 for side in depth_m.shape)
    v, u = torch.meshgrid(*centres, indexing="ij")
    offset = back_px - torch.stack([u, v], dim=-1)
    away_px = torch.sqrt(offset.square().sum(dim=-1) + 1e-12)
    return away_px, known & seen & inside & (back_z > NEAR_M) & (away_px.detach() < noise_px)


def neighbour_losses(
    one: Side, other: Side, *, noise_px: float, patches_max: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """The geometric loss (mean weighted distance [px]) and the photometric one (mean weighted 1 - NCC^2).

    Args:
        one: The view whose pixels are compared.
        other: Its neighbour.
        noise_px: Pixels that come back farther away do not count: something hides them.
        patches_max: At most so many patches are compared.
        rng: Chooses them.
    """
    away_px, counts = there_and_back(one, other, noise_px)
    if not bool(counts.any()):
        zero = 0.0 * one.planes.sum()
        return zero, zero
    weights = torch.exp(-away_px.detach())
    geometric = (weights * away_px)[counts].mean()
    rows = np.flatnonzero(counts.reshape(-1).cpu().numpy())
    if len(rows) > patches_max:
        rows = np.sort(rng.choice(rows, patches_max, replace=False))
    chosen = torch.from_numpy(rows).to(counts.device)
    differences = patch_differences(one, other, chosen)
    kept = differences.detach() < NCC_MAX
    if not bool(kept.any()):
        return geometric, 0.0 * geometric
    return geometric, (weights.reshape(-1)[chosen] * differences)[kept].mean()


def patch_differences(one: Side, other: Side, pixels: Tensor) -> Tensor:
    """1 - NCC^2 of grey patches around pixels, carried to the other view by the homography of their planes.

    Args:
        one: The view.
        other: Its neighbour.
        pixels: Numbers of the pixels, row by row, shape (n,).

    Returns:
        In 0..2, shape (n,).
    """
    width = one.grey.shape[1]
    planes = one.planes.reshape(-1, 4)[pixels]
    normals_C, distance_m = planes[:, :3] @ one.R_WC, planes[:, 3]
    R_OC = other.R_WC.T @ one.R_WC
    t_O = (one.p_WC - other.p_WC) @ other.R_WC
    planar = R_OC - t_O[None, :, None] * (normals_C / distance_m[:, None])[:, None, :]
    homography = other.K_px @ planar @ torch.linalg.inv(one.K_px)
    centres = torch.stack([pixels % width, pixels // width], dim=1).to(planes.dtype) + 0.5
    side = torch.arange(PATCH_PX, dtype=planes.dtype, device=planes.device) - PATCH_PX // 2
    dv, du = torch.meshgrid(side, side, indexing="ij")
    p_px = centres[:, None] + torch.stack([du.reshape(-1), dv.reshape(-1)], dim=1)
    mapped = torch.cat([p_px, torch.ones_like(p_px[..., :1])], dim=2) @ homography.mT
    depth = mapped[..., 2:]
    there = mapped[..., :2] / torch.where(depth.abs() > 1e-6, depth, 1e-6)
    return _one_minus_ncc(one.sample_image(one.grey, p_px), other.sample_image(other.grey, there))


def _one_minus_ncc(a: Tensor, b: Tensor) -> Tensor:
    a, b = a - a.mean(dim=1, keepdim=True), b - b.mean(dim=1, keepdim=True)
    product, squares = (a * b).mean(dim=1), a.square().mean(dim=1) * b.square().mean(dim=1)
    return (1.0 - product.square() / (squares + 1e-8)).clamp(0.0, 2.0)
