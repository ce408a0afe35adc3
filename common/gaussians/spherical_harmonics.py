"""Real spherical harmonics in 3DGS order and sign, degrees 0 to 3, and their rotation."""

import math
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array, Float64Array

SH_C0 = 0.28209479177387814
SH_C1 = 0.4886025119029199
SH_C2 = 1.0925484305920792
SH_C20 = 0.31539156525252005
SH_C3 = 0.5900435899266435
SH_C30 = 0.3731763325901154
SH_C31 = 0.4570457994644658
SH_C32 = 1.445305721320277
"""Factors of the basis polynomials: of degree 0, 1, 2 and 3; the second digit is the order where orders differ."""


def rgb_of_sh(sh: AnyArray) -> AnyArray:
    """Colours, 0..1, of coefficients of degree 0, not clipped; any shape."""
    return 0.5 + SH_C0 * sh


def sh_of_rgb(rgb: AnyArray) -> AnyArray:
    """Coefficients of degree 0 of colours, 0..1; any shape."""
    return (rgb - 0.5) / SH_C0


def sh_basis(directions: npt.ArrayLike, degree: int) -> Float64Array:
    """Basis functions of all degrees up to `degree`.

    Args:
        directions: Unit vectors, shape (N, 3).
        degree: 0..3.

    Returns:
        Values, shape (N, (degree + 1)^2).
    """
    x, y, z = np.asarray(directions, dtype=np.float64).T
    values = [np.full_like(x, SH_C0), *sh_polynomials(x, y, z)]
    return np.stack(values[: (degree + 1) ** 2], axis=1)


def rgb_along(sh: AnyArray, towards: Float64Array) -> Float64Array:
    """Colours of Gaussians as a camera sees them, at least 0, not clipped above 1, shape (N, 3).

    Args:
        sh: Coefficients, shape (N, (degree + 1)^2, 3).
        towards: From the camera to each Gaussian, of any length, shape (N, 3).
    """
    basis = sh_basis(towards / np.linalg.norm(towards, axis=1, keepdims=True), math.isqrt(sh.shape[1]) - 1)
    rgb: Float64Array = np.maximum(0.5 + np.einsum("nk,nkc->nc", basis, sh.astype(np.float64)), 0.0)
    return rgb


def sh_polynomials(x: Any, y: Any, z: Any) -> list[Any]:
    """Basis functions of degrees 1 to 3 at unit vectors: 15 values of the shape of `x`, arrays or tensors."""
    xx, yy, zz = x * x, y * y, z * z
    return [
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        SH_C2 * x * y,
        -SH_C2 * y * z,
        SH_C20 * (2 * zz - xx - yy),
        -SH_C2 * x * z,
        0.5 * SH_C2 * (xx - yy),
        -SH_C3 * y * (3 * xx - yy),
        2 * SH_C32 * x * y * z,
        -SH_C31 * y * (4 * zz - xx - yy),
        SH_C30 * z * (2 * zz - 3 * xx - 3 * yy),
        -SH_C31 * x * (4 * zz - xx - yy),
        SH_C32 * z * (xx - yy),
        -SH_C3 * x * (xx - 3 * yy),
    ]


@cache
def _sample_directions() -> Float64Array:
    """64 unit vectors on a Fibonacci spiral: enough to determine every degree with a small condition number."""
    k = np.arange(64) + 0.5
    z = 1 - 2 * k / 64
    angle = np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def rotate_sh(sh: Float32Array, R: npt.ArrayLike) -> Float32Array:
    """Coefficients of colours that are rotated with their Gaussians: seen along R d, the colour is the old one along d.

    Each degree is a separate representation: its matrix follows from the basis at a fixed set of directions.

    Args:
        sh: Coefficients, shape (N, K, 3), K = 1, 4, 9 or 16.
        R: Rotation, shape (3, 3).

    Returns:
        Rotated coefficients, shape (N, K, 3).
    """
    degree = round(np.sqrt(sh.shape[1])) - 1
    directions = _sample_directions()
    old = sh_basis(directions, degree)
    new = sh_basis(directions @ np.asarray(R, dtype=np.float64).T, degree)
    out = sh.copy()
    for band in range(1, degree + 1):
        rows = slice(band * band, (band + 1) ** 2)
        # new[:, rows] @ D = old[:, rows]: values at R d of the rotated colour equal those at d of the given one.
        D = np.linalg.lstsq(new[:, rows], old[:, rows], rcond=None)[0]
        out[:, rows] = np.einsum("jk,nkc->njc", D, sh[:, rows].astype(np.float64))
    return out
