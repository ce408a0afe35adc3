"""Rotations of posed Gaussians."""

from typing import Any

from readygo.common.kernels import inline_kernel
from readygo.common.simd.types import fma, fms, mask_bits

ALMOST_ROTATION = 3e-4
"""Distance of a determinant from 1 that one more step of `nearest_rotation` brings below the precision of float32."""


@inline_kernel
def nearest_rotation(M: Any) -> Any:
    """Rotation nearest to a blend of rotations, row by row, nine values: Newton's iteration M <- (M + M^-T) / 2.

    With the cofactors c of M, M^-T = c / det M: the rows of c are the cross products of the other two rows of M.

    It squares the distance of the singular values from 1. They are at most 1 at first and at least 1 after a step, so
    that the determinant bounds them. Four steps bring 0.5, a blend of rotations that are 120 deg apart, to 1 within
    1e-7; most blends need two.

    Source: Higham, Computing the polar decomposition - with applications, 1986.
    """
    for _ in range(4):
        c0, c1, c2 = (
            fms(M[4], M[8], M[5] * M[7]),
            fms(M[5], M[6], M[3] * M[8]),
            fms(M[3], M[7], M[4] * M[6]),
        )
        c3, c4, c5 = (
            fms(M[2], M[7], M[1] * M[8]),
            fms(M[0], M[8], M[2] * M[6]),
            fms(M[1], M[6], M[0] * M[7]),
        )
        c6, c7, c8 = (
            fms(M[1], M[5], M[2] * M[4]),
            fms(M[2], M[3], M[0] * M[5]),
            fms(M[0], M[4], M[1] * M[3]),
        )
        det = fma(M[0], c0, fma(M[1], c1, M[2] * c2))
        # M / 2 + c / (2 det).
        s = 0.5 / det
        M = (
            fma(M[0], 0.5, c0 * s), fma(M[1], 0.5, c1 * s), fma(M[2], 0.5, c2 * s),
            fma(M[3], 0.5, c3 * s), fma(M[4], 0.5, c4 * s), fma(M[5], 0.5, c5 * s),
            fma(M[6], 0.5, c6 * s), fma(M[7], 0.5, c7 * s), fma(M[8], 0.5, c8 * s),
        )  # fmt: skip
        if mask_bits(det >= 1.0 - ALMOST_ROTATION) & mask_bits(det <= 1.0 + ALMOST_ROTATION) == 0xFFFF:
            break
    return M
