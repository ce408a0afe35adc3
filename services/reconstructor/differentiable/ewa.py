"""Where a camera maps sixteen Gaussians.

Legend: R = R_CW and Q, the rotation of a Gaussian, row by row, nine values; d = mean - camera centre in the world [m];
(uc, vc) tangents at which the projection is linearised. The image covariance is A A^T + `DILATION_PX2` I with the image
axes A = diag(fx / z, fy / z) E Q diag(scales), E = [[1, 0, -uc], [0, 1, -vc]] R; see `project_gradients`.
"""

from typing import Any

from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import DILATION_PX2
from readygo.common.simd.types import fma, fms, fnma


@inline_kernel
def to_camera(R: Any, d: Any) -> Any:
    """Camera coordinates of offsets from the camera."""
    return (
        fma(R[0], d[0], fma(R[1], d[1], R[2] * d[2])),
        fma(R[3], d[0], fma(R[4], d[1], R[5] * d[2])),
        fma(R[6], d[0], fma(R[7], d[1], R[8] * d[2])),
    )


@inline_kernel
def quaternion_matrix(w: Any, x: Any, y: Any, z: Any) -> Any:
    """Rotation matrices of quaternions that need not be of length 1, row by row."""
    # R = I + 2 / |q|^2 (w [v]x + v v^T - |v|^2 I), v = (x, y, z).
    twice = 2.0 / fma(w, w, fma(x, x, fma(y, y, z * z)))
    wt, xt, yt, zt = w * twice, x * twice, y * twice, z * twice
    return (
        1.0 - fma(yt, y, zt * z), fms(xt, y, wt * z), fma(xt, z, wt * y),
        fma(xt, y, wt * z), 1.0 - fma(xt, x, zt * z), fms(yt, z, wt * x),
        fms(xt, z, wt * y), fma(yt, z, wt * x), 1.0 - fma(xt, x, yt * y),
    )  # fmt: skip


@inline_kernel
def image_rows(R: Any, uc: Any, vc: Any) -> Any:
    """The two rows of J R_CW without the factors fx / z and fy / z."""
    return (
        fnma(uc, R[6], R[0]), fnma(uc, R[7], R[1]), fnma(uc, R[8], R[2]),
        fnma(vc, R[6], R[3]), fnma(vc, R[7], R[4]), fnma(vc, R[8], R[5]),
    )  # fmt: skip


@inline_kernel
def image_axes(E: Any, Q: Any) -> Any:
    """The rows `image_rows` times the axes of the Gaussians, row by row, six values."""
    return (
        fma(E[0], Q[0], fma(E[1], Q[3], E[2] * Q[6])),
        fma(E[0], Q[1], fma(E[1], Q[4], E[2] * Q[7])),
        fma(E[0], Q[2], fma(E[1], Q[5], E[2] * Q[8])),
        fma(E[3], Q[0], fma(E[4], Q[3], E[5] * Q[6])),
        fma(E[3], Q[1], fma(E[4], Q[4], E[5] * Q[7])),
        fma(E[3], Q[2], fma(E[4], Q[5], E[5] * Q[8])),
    )


@inline_kernel
def image_covariance(a: Any, b: Any) -> Any:
    """Covariance xx, xy, yy [px2] of Gaussians whose axes end at (a_k, b_k) in the image, and its determinant.

    With axes a, b and the dilation d: det = |a x b|^2 + d (|a|^2 + |b|^2) + d^2, which does not cancel for needles.
    """
    aa, bb = fma(a[0], a[0], fma(a[1], a[1], a[2] * a[2])), fma(b[0], b[0], fma(b[1], b[1], b[2] * b[2]))
    ab = fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))
    n0, n1, n2 = fms(a[1], b[2], a[2] * b[1]), fms(a[2], b[0], a[0] * b[2]), fms(a[0], b[1], a[1] * b[0])
    flat = fma(aa + bb, DILATION_PX2, DILATION_PX2 * DILATION_PX2)
    return aa + DILATION_PX2, ab, bb + DILATION_PX2, fma(n0, n0, fma(n1, n1, fma(n2, n2, flat)))
