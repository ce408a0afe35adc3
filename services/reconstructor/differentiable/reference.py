"""The slow, obvious differentiable rasterizer that the fast one is compared with: plain torch, any precision.

Every Gaussian meets every pixel, so time and memory grow with their product.
"""

from dataclasses import dataclass

import numpy.typing as npt
import torch

from readygo.common.gaussians.spherical_harmonics import SH_C0, sh_polynomials
from readygo.common.rasterizer.constants import (
    ALPHA_MAX,
    ALPHA_MIN,
    DILATION_PX2,
    FOV_MARGIN,
    NEAR_M,
    TRANSMITTANCE_MIN,
)

Tensor = torch.Tensor
PIXELS_AT_ONCE = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceRendered:
    """Images of one view, as in `autograd.Rendered`."""

    rgb: Tensor | None
    features: Tensor | None
    depth_m: Tensor
    alpha: Tensor
    index: Tensor
    """Gaussians that were drawn, nearest first, shape (n,)."""
    means_px: Tensor
    """Their projected means [px], with gradients kept, shape (n, 2)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Splats:
    """Gaussians in the image, nearest first."""

    means_px: Tensor
    conic: Tensor
    opacity: Tensor
    values: Tensor
    """What is blended: colour, features, depth."""


def rasterize_with_torch(
    means_m: Tensor,
    quats_wxyz: Tensor,
    scales_m: Tensor,
    opacities: Tensor,
    sh: Tensor | None = None,
    features: Tensor | None = None,
    *,
    T_world_camera: Tensor,
    K_px: npt.ArrayLike,
    height_px: int,
    width_px: int,
    sh_degree: int = 3,
    background: Tensor | None = None,
) -> ReferenceRendered:
    """Draw Gaussians; arguments and images are those of `autograd.rasterize`, in the precision of `means_m`."""
    K = torch.as_tensor(K_px, dtype=means_m.dtype)
    pose = T_world_camera.to(means_m.dtype)
    offsets = means_m - pose[:3, 3]
    depth = (offsets @ pose[:3, :3])[:, 2].detach()
    index = torch.nonzero((depth > NEAR_M) & (opacities >= ALPHA_MIN))[:, 0]
    index = index[torch.argsort(depth[index], stable=True)]
    p_C = offsets[index] @ pose[:3, :3]
    means_px = torch.stack([p_C[:, k] / p_C[:, 2] * K[k, k] + K[k, 2] for k in range(2)], dim=1)
    if means_px.requires_grad:
        means_px.retain_grad()
    values = [p_C[:, 2:]]
    if sh is not None:
        values.insert(0, colours_along(sh[index], offsets[index], sh_degree))
    if features is not None:
        values.append(features[index])
    splats = _Splats(
        means_px=means_px,
        conic=_conics(p_C, quats_wxyz[index], scales_m[index], pose[:3, :3].T, K, height_px, width_px),
        opacity=opacities[index],
        values=torch.cat(values, dim=1),
    )
    blended, transmittance = _blend(splats, height_px, width_px)
    first = 0 if sh is None else 3
    alpha = 1.0 - transmittance
    something = alpha > 0
    rgb = None if sh is None else blended[..., :3]
    if rgb is not None and background is not None:
        rgb = rgb + transmittance[..., None] * background
    return ReferenceRendered(
        rgb=rgb,
        features=None if features is None else blended[..., first + 1 :],
        depth_m=torch.where(something, blended[..., first] / torch.where(something, alpha, 1.0), torch.inf),
        alpha=alpha,
        index=index,
        means_px=means_px,
    )


def _conics(
    p_C: Tensor, quats_wxyz: Tensor, scales_m: Tensor, R_CW: Tensor, K: Tensor, height_px: int, width_px: int
) -> Tensor:
    """Inverse covariances in the image, shape (n, 2, 2)."""
    x, y, z = p_C.unbind(1)
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    margin_x, margin_y = FOV_MARGIN * 0.5 * width_px / fx, FOV_MARGIN * 0.5 * height_px / fy
    u = torch.clamp(x / z, -cx / fx - margin_x, (width_px - cx) / fx + margin_x)
    v = torch.clamp(y / z, -cy / fy - margin_y, (height_px - cy) / fy + margin_y)
    zero = torch.zeros_like(z)
    J = torch.stack(
        [torch.stack([fx / z, zero, -fx * u / z], dim=-1), torch.stack([zero, fy / z, -fy * v / z], dim=-1)], dim=-2
    )
    axes = J @ R_CW @ (rotations(quats_wxyz) * scales_m[:, None, :])
    inverse: Tensor = torch.linalg.inv(axes @ axes.mT + DILATION_PX2 * torch.eye(2, dtype=p_C.dtype))
    return inverse


def rotations(quats_wxyz: Tensor) -> Tensor:
    """Rotation matrices of quaternions of any length, shape (n, 4) -> (n, 3, 3)."""
    w, x, y, z = (quats_wxyz / torch.linalg.norm(quats_wxyz, dim=1, keepdim=True)).unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def colours_along(sh: Tensor, offsets: Tensor, degree: int) -> Tensor:
    """Colours along directions, not negative, shape (n, 3). The basis is that of `readygo.common.gaussians.sh_basis`.

    Args:
        sh: Coefficients in 3DGS order, shape (n, K, 3).
        offsets: From the camera to the means, of any length, shape (n, 3).
        degree: Higher degrees are left out.
    """
    x, y, z = (offsets / torch.linalg.norm(offsets, dim=1, keepdim=True)).unbind(1)
    basis = [torch.full_like(x, SH_C0), *sh_polynomials(x, y, z)]
    used = min((degree + 1) ** 2, sh.shape[1])
    return torch.clamp(0.5 + torch.einsum("kn,nkc->nc", torch.stack(basis[:used]), sh[:, :used]), min=0.0)


def _blend(splats: _Splats, height_px: int, width_px: int) -> tuple[Tensor, Tensor]:
    """Blended values, shape (H, W, C), and transmittances, shape (H, W)."""
    dtype = splats.means_px.dtype
    row, column = torch.meshgrid(
        torch.arange(height_px, dtype=dtype), torch.arange(width_px, dtype=dtype), indexing="ij"
    )
    pixels = torch.stack([column, row], dim=-1).reshape(-1, 2) + 0.5
    parts = [_blend_pixels(splats, part) for part in torch.split(pixels, PIXELS_AT_ONCE)]
    values, transmittance = (torch.cat(images) for images in zip(*parts, strict=True))
    return values.reshape(height_px, width_px, -1), transmittance.reshape(height_px, width_px)


def _blend_pixels(splats: _Splats, pixels: Tensor) -> tuple[Tensor, Tensor]:
    d = pixels[:, None] - splats.means_px[None]
    power = -0.5 * torch.einsum("pni,nij,pnj->pn", d, splats.conic, d)
    alpha = torch.clamp(splats.opacity * torch.exp(power), max=ALPHA_MAX)
    alpha = torch.where(alpha >= ALPHA_MIN, alpha, 0.0)
    behind = torch.cumprod(1.0 - alpha, dim=1)
    before = torch.cat([torch.ones_like(behind[:, :1]), behind[:, :-1]], dim=1)
    weight = torch.where(before >= TRANSMITTANCE_MIN, alpha * before, 0.0)
    return weight @ splats.values, 1.0 - weight.sum(dim=1)
