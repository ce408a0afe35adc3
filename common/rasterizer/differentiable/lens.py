"""The camera of the projection, and where it maps sixteen Gaussians."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from common.rasterizer.compilation import inlined
from common.rasterizer.constants import DILATION_PX2, FOV_MARGIN
from common.rasterizer.cpu_view import View
from common.rasterizer.simd_types import f16, fma, fms, fnma, maximum, minimum

Float64s = npt.NDArray[np.float64]


class Lens(NamedTuple):
    """Camera constants in float32."""

    fx: np.float32
    fy: np.float32
    cx: np.float32
    cy: np.float32
    u_low: np.float32
    u_high: np.float32
    v_low: np.float32
    v_high: np.float32
    x_last: np.float32
    y_last: np.float32
    columns: int


@inlined
def lens_of(view: View) -> Lens:
    """Constants of a view; tangents are clamped as `FOV_MARGIN` says."""
    margin_u, margin_v = FOV_MARGIN * 0.5 * view.width / view.fx, FOV_MARGIN * 0.5 * view.height / view.fy
    return Lens(
        np.float32(view.fx),
        np.float32(view.fy),
        np.float32(view.cx),
        np.float32(view.cy),
        np.float32(-view.cx / view.fx - margin_u),
        np.float32((view.width - view.cx) / view.fx + margin_u),
        np.float32(-view.cy / view.fy - margin_v),
        np.float32((view.height - view.cy) / view.fy + margin_v),
        np.float32(view.width - 1),
        np.float32(view.height - 1),
        (view.width + 15) >> 4,
    )


@inlined
def rotation_rows(R: Float64s) -> Any:
    """The nine numbers of a rotation, row by row, in every lane."""
    return (
        f16(R[0, 0]), f16(R[0, 1]), f16(R[0, 2]),
        f16(R[1, 0]), f16(R[1, 1]), f16(R[1, 2]),
        f16(R[2, 0]), f16(R[2, 1]), f16(R[2, 2]),
    )  # fmt: skip


@inlined
def to_camera(R: Any, d: Any) -> Any:
    """Camera coordinates of offsets from the camera."""
    return (
        fma(R[0], d[0], fma(R[1], d[1], R[2] * d[2])),
        fma(R[3], d[0], fma(R[4], d[1], R[5] * d[2])),
        fma(R[6], d[0], fma(R[7], d[1], R[8] * d[2])),
    )


@inlined
def quaternion_matrix(w: Any, x: Any, y: Any, z: Any) -> Any:
    """Rotation matrices of quaternions that need not be of length 1, row by row."""
    twice = 2.0 / fma(w, w, fma(x, x, fma(y, y, z * z)))
    wt, xt, yt, zt = w * twice, x * twice, y * twice, z * twice
    return (
        1.0 - fma(yt, y, zt * z), fms(xt, y, wt * z), fma(xt, z, wt * y),
        fma(xt, y, wt * z), 1.0 - fma(xt, x, zt * z), fms(yt, z, wt * x),
        fms(xt, z, wt * y), fma(yt, z, wt * x), 1.0 - fma(xt, x, yt * y),
    )  # fmt: skip


@inlined
def clamped(lens: Lens, u: Any, v: Any) -> Any:
    """Tangents at which the projection is linearised."""
    return maximum(minimum(u, lens.u_high), lens.u_low), maximum(minimum(v, lens.v_high), lens.v_low)


@inlined
def image_rows(R: Any, uc: Any, vc: Any) -> Any:
    """The two rows of J R_CW without the factors fx / z and fy / z."""
    return (
        fnma(uc, R[6], R[0]), fnma(uc, R[7], R[1]), fnma(uc, R[8], R[2]),
        fnma(vc, R[6], R[3]), fnma(vc, R[7], R[4]), fnma(vc, R[8], R[5]),
    )  # fmt: skip


@inlined
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


@inlined
def image_covariance(a: Any, b: Any) -> Any:
    """Covariance xx, xy, yy [px2] of Gaussians whose axes end at (a_k, b_k) in the image, and its determinant.

    With axes a, b and the dilation d: det = |a x b|^2 + d (|a|^2 + |b|^2) + d^2, which does not cancel for needles.
    """
    aa, bb = fma(a[0], a[0], fma(a[1], a[1], a[2] * a[2])), fma(b[0], b[0], fma(b[1], b[1], b[2] * b[2]))
    ab = fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))
    n0, n1, n2 = fms(a[1], b[2], a[2] * b[1]), fms(a[2], b[0], a[0] * b[2]), fms(a[0], b[1], a[1] * b[0])
    flat = fma(aa + bb, DILATION_PX2, DILATION_PX2 * DILATION_PX2)
    return aa + DILATION_PX2, ab, bb + DILATION_PX2, fma(n0, n0, fma(n1, n1, fma(n2, n2, flat)))
