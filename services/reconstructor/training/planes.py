"""Depth of planes: every Gaussian is a disc whose normal is its shortest axis, and depth is where rays meet its plane.

With N the blended normals that look towards the camera, D the blended distances of the planes from the camera and r the
ray of a pixel at depth 1, the depth is D / -(N . r): it is exact for a flat surface, as the opacity cancels. Normals
are in the world's frame here, and so are rays. Source: Chen et al., PGSR, 2024, section 4.1.
"""

import torch

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.differentiable.reference import rotations

Tensor = torch.Tensor
FACING_MIN = 0.05
"""A plane that is seen flatter than this (cosine, weighted with its opacity) has no depth."""


def plane_features(means_m: Tensor, quats_wxyz: Tensor, scales_m: Tensor, camera_m: Tensor) -> Tensor:
    """Normals towards the camera, and distances of the planes from it, differentiable, shape (N, 4).

    Args:
        means_m: Shape (N, 3).
        quats_wxyz: Shape (N, 4).
        scales_m: Shape (N, 3).
        camera_m: Centre of the camera, shape (3,).
    """
    shortest = scales_m.detach().argmin(dim=1)
    axes = rotations(quats_wxyz)
    normals = axes.gather(2, shortest[:, None, None].expand(-1, 3, 1))[:, :, 0]
    distance_m = (normals * (camera_m - means_m)).sum(dim=1, keepdim=True)
    sign = torch.where(distance_m.detach() < 0, -1.0, 1.0)
    return torch.cat([normals, distance_m], dim=1) * sign


def rays_of(
    K_px: Float64Array,
    size_px: tuple[int, int],
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | None = None,
) -> Tensor:
    """Rays of the pixels' centres at depth 1 in the camera's frame, shape (H, W, 3)."""
    v, u = torch.meshgrid(*(torch.arange(side, dtype=dtype, device=device) + 0.5 for side in size_px), indexing="ij")
    x, y = (u - K_px[0, 2]) / K_px[0, 0], (v - K_px[1, 2]) / K_px[1, 1]
    return torch.stack([x, y, torch.ones_like(x)], dim=2)


def plane_depth(planes: Tensor, rays_W: Tensor) -> tuple[Tensor, Tensor]:
    """Depth along the optical axis, and where there is one.

    Args:
        planes: Blended `plane_features`, shape (H, W, 4).
        rays_W: Rays at depth 1 in the world's axes, shape (H, W, 3).

    Returns:
        Depths [m], 1 where there is none, shape (H, W); a mask.
    """
    facing = -(planes[..., :3] * rays_W).sum(dim=-1)
    known = (facing > FACING_MIN) & (planes[..., 3] > 0)
    return torch.where(known, planes[..., 3] / torch.where(known, facing, 1.0), 1.0), known


def depth_normals(depth_m: Tensor, rays: Tensor) -> Tensor:
    """Unit normals towards the camera of the surface that depths make, by central differences.

    Args:
        depth_m: Shape (H, W).
        rays: At depth 1, in any frame, shape (H, W, 3).

    Returns:
        Normals in the frame of the rays, 0 at the border, shape (H, W, 3).
    """
    points = rays * depth_m[..., None]
    across = points[1:-1, 2:] - points[1:-1, :-2]
    up = points[:-2, 1:-1] - points[2:, 1:-1]
    inner = torch.nn.functional.normalize(torch.linalg.cross(across, up), dim=-1)
    return torch.nn.functional.pad(inner, (0, 0, 1, 1, 1, 1))


def edge_weights(photo: Tensor) -> Tensor:
    """How flat a photo is, as normals of depths tell little at edges: (1 - g)^2 with g its gradient in 0..1.

    Args:
        photo: Shape (3, H, W).

    Returns:
        Shape (H, W), 0 at the border.
    """
    across = (photo[:, 1:-1, 2:] - photo[:, 1:-1, :-2]).abs().mean(dim=0)
    down = (photo[:, 2:, 1:-1] - photo[:, :-2, 1:-1]).abs().mean(dim=0)
    steep = torch.maximum(across, down)
    steep = (steep - steep.min()) / (steep.max() - steep.min()).clamp(min=1e-8)
    return torch.nn.functional.pad((1.0 - steep).square(), (1, 1, 1, 1))


def normal_loss(planes: Tensor, alpha: Tensor, rays_W: Tensor, weights: Tensor) -> Tensor:
    """Mean over all pixels of how much blended normals differ from those of the depths, weighted.

    Args:
        planes: Blended `plane_features`, shape (H, W, 4).
        alpha: Shape (H, W).
        rays_W: Shape (H, W, 3).
        weights: Shape (H, W), see `edge_weights`.
    """
    depth_m, known = plane_depth(planes, rays_W)
    normals = depth_normals(depth_m, rays_W) * alpha.detach()[..., None]
    difference = (normals - planes[..., :3]).abs().sum(dim=-1)
    return (difference * weights * known).mean()
