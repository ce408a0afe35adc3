"""Covariance of one Gaussian, for compiled loops."""

import math

from readygo.common.kernels import kernel_with_cache

Covariance = tuple[float, float, float, float, float, float]
"""The entries xx, xy, xz, yy, yz, zz."""


@kernel_with_cache(inline="always")
def rotation_of(
    w: float, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Rotation matrix of a quaternion that need not be normalised, row by row."""
    n = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * n, x * n, y * n, z * n
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


@kernel_with_cache(inline="always")
def covariance_of(w: float, x: float, y: float, z: float, s0: float, s1: float, s2: float) -> Covariance:
    """Covariance entries of a Gaussian with quaternion (w, x, y, z) and standard deviations s0, s1, s2 [m]."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_of(w, x, y, z)
    a, b, c = s0 * s0, s1 * s1, s2 * s2
    return (
        a * r00 * r00 + b * r01 * r01 + c * r02 * r02,
        a * r00 * r10 + b * r01 * r11 + c * r02 * r12,
        a * r00 * r20 + b * r01 * r21 + c * r02 * r22,
        a * r10 * r10 + b * r11 * r11 + c * r12 * r12,
        a * r10 * r20 + b * r11 * r21 + c * r12 * r22,
        a * r20 * r20 + b * r21 * r21 + c * r22 * r22,
    )
