"""Which chunks and which blocks of 16 Gaussians may touch the image.

Legend: p = (x, y, z) means in the camera's frame [m]; `reach` how far their footprints go along both image axes, times
depth [px m]; a footprint covers the columns fx x / z + cx +- (reach / z + PAD_PX). `bounds` has five rows of 16 lanes,
each a smallest value so far: depth, left, -right, top, -bottom of the footprints, the borders [px] from (cx, cy).
"""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import ALPHA_MIN, NEAR_M
from readygo.common.rasterizer.cpu.optics import Optics, optics_of, rotation_rows
from readygo.common.rasterizer.cpu.tiles import pack_box
from readygo.common.rasterizer.cpu.view import PAD_PX, PinholeView
from readygo.common.rasterizer.cpu.workspace import BLOCK_BITS
from readygo.common.simd.memory import load_f16, poke, prefetch, store_f16
from readygo.common.simd.types import LANES, f16, fma, lane_number, mask_bits, maximum, minimum, where
from readygo.services.reconstructor.differentiable.ewa import to_camera
from readygo.services.reconstructor.differentiable.memory import CHUNK, Chunks, Cloud
from readygo.services.reconstructor.differentiable.released import kernel_without_gil
from readygo.services.reconstructor.differentiable.simd_rows import columns_of_three, load_first

REACH = math.sqrt(2.0 * math.log(1.0 / ALPHA_MIN))
"""Standard deviations beyond which an opaque Gaussian is not drawn."""
BLOCKS = CHUNK // LANES
"""Blocks of 16 Gaussians per chunk."""
AHEAD = 512
"""Gaussians for which memory is asked in advance."""
FAR = np.float32(3e38)
"""Bounds at first."""
NEAREST, LEFT, RIGHT, TOP, BOTTOM = 0, 1, 2, 3, 4
"""Rows of the bounds."""


@inline_kernel
def from_camera(view: PinholeView, axis: int, p: Any) -> Any:
    """World coordinates along an axis relative to the camera."""
    # In two steps, so that the difference of large coordinates loses nothing.
    near = np.float32(view.p_WC[axis])
    return (p - near) - (view.p_WC[axis] - near)


@inline_kernel
def offsets_from_camera(view: PinholeView, cloud: Cloud, first: int, left: int) -> Any:
    """World coordinates of the Gaussians first..first+15 relative to the camera; 0 from the `left`-th on."""
    p = columns_of_three(
        load_first(cloud.means_m, 3 * first, 3 * left),
        load_first(cloud.means_m, 3 * first + LANES, 3 * left - LANES),
        load_first(cloud.means_m, 3 * first + 2 * LANES, 3 * left - 2 * LANES),
    )
    return from_camera(view, 0, p[0]), from_camera(view, 1, p[1]), from_camera(view, 2, p[2])


@inline_kernel
def scales_at(cloud: Cloud, first: int, left: int) -> Any:
    """Scales of the Gaussians first..first+15."""
    return columns_of_three(
        load_first(cloud.scales_m, 3 * first, 3 * left),
        load_first(cloud.scales_m, 3 * first + LANES, 3 * left - LANES),
        load_first(cloud.scales_m, 3 * first + 2 * LANES, 3 * left - 2 * LANES),
    )


@inline_kernel
def footprint_reach(optics: Optics, s: Any) -> Any:
    """How far Gaussians reach in the image, times depth [px m].

    A ball of radius r at tangent u and depth z reaches r sqrt(1 + u^2) / z; u is clamped in the projection.
    """
    reach = maximum(maximum(s[0], s[1]), s[2]) * REACH
    u, v = max(-optics.u_low, optics.u_high), max(-optics.v_low, optics.v_high)
    return reach * (optics.fx * math.sqrt(1.0 + u * u)), reach * (optics.fy * math.sqrt(1.0 + v * v))


@inline_kernel
def in_view(optics: Optics, p: Any, reach: Any, opacity: Any, left: int) -> Any:
    """Lanes whose footprints may meet the image; camera coordinates `p`."""
    x, y = p[0] * optics.fx, p[1] * optics.fy
    # Times z, so that nothing is divided: z (cx + PAD_PX) + fx x + reach >= 0 at the left border, and so on.
    return (
        (p[2] > NEAR_M)
        & (lane_number() < left)
        & (opacity >= ALPHA_MIN)
        & (fma(p[2], optics.cx + PAD_PX, x + reach[0]) >= 0.0)
        & (fma(p[2], optics.x_last + 1.0 - optics.cx + PAD_PX, reach[0] - x) >= 0.0)
        & (fma(p[2], optics.cy + PAD_PX, y + reach[1]) >= 0.0)
        & (fma(p[2], optics.y_last + 1.0 - optics.cy + PAD_PX, reach[1] - y) >= 0.0)
    )


@inline_kernel
def _begin_bounds(bounds: Float32Array) -> None:
    for k in range(BOTTOM + 1):
        store_f16(bounds, LANES * k, f16(FAR))


@inline_kernel
def _widen(bounds: Float32Array, k: int, seen: Any, value: Any) -> None:
    """Lower the k-th bound to `value` in the lanes that are seen."""
    old = load_f16(bounds, LANES * k)
    store_f16(bounds, LANES * k, where(seen, minimum(value, old), old))


@inline_kernel
def _bound(bounds: Float32Array, k: int) -> float:
    """The smallest lane of the k-th bound."""
    low: float = bounds[LANES * k]
    for lane in range(1, LANES):
        low = min(low, bounds[LANES * k + lane])
    return low


@inline_kernel
def _bound_block(view: PinholeView, optics: Optics, R: Any, cloud: Cloud, first: int, bounds: Float32Array) -> int:
    """Widen the bounds by a block of 16 Gaussians; the lanes that may touch the image."""
    left = len(cloud.opacities) - first
    for k in range(0, 3 * LANES, LANES):
        prefetch(cloud.means_m, 3 * (first + AHEAD) + k)
        prefetch(cloud.scales_m, 3 * (first + AHEAD) + k)
    prefetch(cloud.opacities, first + AHEAD)
    p = to_camera(R, offsets_from_camera(view, cloud, first, left))
    if mask_bits((p[2] > NEAR_M) & (lane_number() < left)) == 0:
        return 0
    reach = footprint_reach(optics, scales_at(cloud, first, left))
    seen = in_view(optics, p, reach, load_first(cloud.opacities, first, left), left)
    bits: int = mask_bits(seen)
    if bits:
        inverse_z = 1.0 / p[2]
        x, y = p[0] * inverse_z * optics.fx, p[1] * inverse_z * optics.fy
        _widen(bounds, NEAREST, seen, p[2])
        _widen(bounds, LEFT, seen, x - reach[0] * inverse_z)
        _widen(bounds, RIGHT, seen, 0.0 - (x + reach[0] * inverse_z))
        _widen(bounds, TOP, seen, y - reach[1] * inverse_z)
        _widen(bounds, BOTTOM, seen, 0.0 - (y + reach[1] * inverse_z))
    return bits


@inline_kernel
def _to_block(pixel: float, last: float) -> int:
    """Number of the 4-px block that holds a pixel coordinate, moved into the image."""
    return int(min(max(pixel, 0.0), last)) >> BLOCK_BITS


@kernel_without_gil
def bound_chunks(view: PinholeView, cloud: Cloud, bounds: Float32Array, out: Chunks) -> int:
    """Write the chunks that may touch the image, and return their number.

    Args:
        view: Camera.
        cloud: Parameters.
        bounds: Scratch memory, shape (5 * 16,).
        out: Where to write, with room for all chunks.
    """
    optics, R = optics_of(view), rotation_rows(view.R_CW)
    count = len(cloud.opacities)
    n = 0
    for start in range(0, count, CHUNK):
        some = 0
        _begin_bounds(bounds)
        for block in range(BLOCKS):
            left = count - start - LANES * block
            lanes = _bound_block(view, optics, R, cloud, start + LANES * block, bounds) if left > 0 else 0
            poke(out.lanes, BLOCKS * n + block, lanes)
            some |= lanes
        if some == 0:
            continue
        x0 = _to_block(optics.cx + _bound(bounds, LEFT) - PAD_PX, optics.x_last)
        x1 = _to_block(optics.cx - _bound(bounds, RIGHT) + PAD_PX, optics.x_last)
        y0 = _to_block(optics.cy + _bound(bounds, TOP) - PAD_PX, optics.y_last)
        y1 = _to_block(optics.cy - _bound(bounds, BOTTOM) + PAD_PX, optics.y_last)
        out.number[n] = start // CHUNK
        out.depth_m[n] = _bound(bounds, NEAREST)
        out.box[n] = pack_box(x0, x1, y0, y1)
        out.group_count[n] = 0
        n += 1
    return n
