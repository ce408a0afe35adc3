"""The camera as the projection kernels take it: float32 constants, sixteen lanes wide where they need it.

A point (x, y, z) of the camera's frame has the tangents u = x / z, v = y / z and the pixel (fx u + cx, fy v + cy).
"""

from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import FOV_MARGIN
from readygo.common.rasterizer.cpu.view import PinholeView
from readygo.common.rasterizer.cpu.workspace import TILE, TILE_BITS
from readygo.common.simd.types import f16, maximum, minimum


class Optics(NamedTuple):
    """Camera constants in float32."""

    fx: np.float32
    """Focal lengths [px]."""
    fy: np.float32
    cx: np.float32
    """Principal point [px]."""
    cy: np.float32
    u_low: np.float32
    """Bounds of the tangents at which the projection is linearised."""
    u_high: np.float32
    v_low: np.float32
    v_high: np.float32
    x_last: np.float32
    """Last column and last row of the image [px]."""
    y_last: np.float32
    columns: int
    """Tiles along an image row."""


@inline_kernel
def optics_of(view: PinholeView) -> Optics:
    """Constants of a view; tangents are clamped as `FOV_MARGIN` says."""
    # Half the image spans width / (2 fx) of the tangent: the bounds lie `FOV_MARGIN` of that beyond its borders.
    margin_u, margin_v = FOV_MARGIN * 0.5 * view.width / view.fx, FOV_MARGIN * 0.5 * view.height / view.fy
    return Optics(
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
        (view.width + TILE - 1) >> TILE_BITS,
    )


@inline_kernel
def clamp_tangents(optics: Optics, u: Any, v: Any) -> Any:
    """Tangents at which the projection is linearised."""
    return maximum(minimum(u, optics.u_high), optics.u_low), maximum(minimum(v, optics.v_high), optics.v_low)


@inline_kernel
def rotation_rows(R: Float64Array) -> Any:
    """The nine numbers of a rotation, row by row, in every lane."""
    return (
        f16(R[0, 0]), f16(R[0, 1]), f16(R[0, 2]),
        f16(R[1, 0]), f16(R[1, 1]), f16(R[1, 2]),
        f16(R[2, 0]), f16(R[2, 1]), f16(R[2, 2]),
    )  # fmt: skip
