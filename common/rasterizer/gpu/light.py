"""Light on humans with torch; what it is made of: `readygo.common.gaussians.irradiance`."""

import torch
from torch import Tensor

from readygo.common.rasterizer.constants import LIGHT_MAX, LIGHT_MIN

TERMS = 10
"""1, x, y, z, xx, yy, zz, xy, xz, yz of a normal."""


def gains(light: Tensor, normals: Tensor) -> Tensor:
    """What the colours of surfaces are multiplied by.

    Args:
        light: Quadratic forms of normals, shape (..., 3, 4, 4).
        normals: Unit normals in the same frame, shape (..., N, 3).

    Returns:
        Shape (..., N, 3).
    """
    n = torch.cat([normals, torch.ones_like(normals[..., :1])], dim=-1)
    values = torch.einsum("...ni,...cij,...nj->...nc", n, light.to(n.dtype), n)
    return values.clamp(LIGHT_MIN, LIGHT_MAX).sqrt()


def turned_terms(light: Tensor, R: Tensor) -> Tensor:
    """Terms of quadratic forms in a turned frame, as `readygo.common.gaussians.irradiance.rotate_forms` writes them.

    Args:
        light: Shape (..., 3, 4, 4).
        R: Maps normals to the other frame, shape (..., 3, 3).

    Returns:
        Shape (..., 3, `TERMS`).
    """
    R = R[..., None, :, :]
    Q = R @ light[..., :3, :3] @ R.mT
    along = 2.0 * (R @ light[..., :3, 3:])[..., 0]
    mixed = torch.stack([2.0 * Q[..., 0, 1], 2.0 * Q[..., 0, 2], 2.0 * Q[..., 1, 2]], dim=-1)
    return torch.cat([light[..., 3, 3:], along, Q.diagonal(dim1=-2, dim2=-1), mixed], dim=-1)
