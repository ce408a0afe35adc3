"""From parameters in any order to records, keys and counts per tile."""

import math
from typing import Any

import numpy as np

from common.rasterizer.compilation import inlined, kernel
from common.rasterizer.constants import ALPHA_MIN, NEAR_M
from common.rasterizer.cpu_project import LOG2_E, NEAR_BITS
from common.rasterizer.cpu_tiles import box_codes, count_entries
from common.rasterizer.cpu_view import PAD_PX, View
from common.rasterizer.cpu_workspace import KEYS, RECORD, RECORD_BOUNDS_X, RECORD_BOUNDS_Y, RECORDS, Workspace
from common.rasterizer.differentiable.colour import colour_block
from common.rasterizer.differentiable.lens import (
    Lens,
    clamped,
    image_axes,
    image_covariance,
    image_rows,
    lens_of,
    quaternion_matrix,
    rotation_rows,
    to_camera,
)
from common.rasterizer.differentiable.memory import COLOURED, RADIUS, STAGED_LANES, STAGED_ROWS, Cloud, Kept
from common.rasterizer.differentiable.simd_rows import columns_of_four, columns_of_three, load_first
from common.rasterizer.simd_memory import (
    compress,
    load_f16,
    load_i16,
    prefetch,
    store_f16,
    store_i16,
    transpose_in_place,
)
from common.rasterizer.simd_types import (
    bit_pattern,
    ceil,
    count_bits,
    float_bits,
    float_of_bits,
    floor,
    fma,
    has_bit,
    i16,
    lane_number,
    lowest_bit,
    mask_bits,
    maximum,
    minimum,
    sqrt,
    to_float,
    truncate,
)

REACH = math.sqrt(2.0 * math.log(1.0 / ALPHA_MIN))
"""Standard deviations beyond which an opaque Gaussian is not drawn."""
LN_4 = 2.0 * math.log(2.0)
TWO_LN_255 = -2.0 * math.log(ALPHA_MIN)


@inlined
def _log2(x: Any) -> Any:
    """Binary logarithm of positive normal numbers, absolute error below 2e-7: a series of artanh((m - 1) / (m + 1))."""
    exponent = (bit_pattern(x) - 0x3F2AAAAB) >> 23
    m = float_of_bits(bit_pattern(x) - (exponent << 23)) - 1.0
    s = m / (m + 2.0)
    ss = s * s
    p = fma(ss, fma(ss, fma(ss, fma(ss, 2.0 / 9.0, 2.0 / 7.0), 2.0 / 5.0), 2.0 / 3.0), 2.0)
    return fma(s * p, LOG2_E, to_float(exponent))


@inlined
def _stage(row: int, staged: int, seen: Any, value: Any, kept: Kept) -> None:
    store_f16(
        kept.staged, row * STAGED_LANES + staged, float_of_bits(compress(seen, bit_pattern(value)))
    )


@inlined
def _stage_block(view: View, lens: Lens, R: Any, cloud: Cloud, first: int, staged: int, kept: Kept) -> int:
    """Append the Gaussians first..first+15 that may be seen to the staged ones; the new number of these.

    The test is that of balls of `REACH` times the largest scale, whose outline in the image is bounded by the largest
    tangent at which the projection is linearised.
    """
    left = len(cloud.opacities) - first
    m0, m1, m2 = (
        load_first(cloud.means_m, 3 * first, 3 * left),
        load_first(cloud.means_m, 3 * first + 16, 3 * left - 16),
        load_first(cloud.means_m, 3 * first + 32, 3 * left - 32),
    )
    px, py, pz = columns_of_three(m0, m1, m2)
    # In two steps, so that the difference of large coordinates loses nothing.
    cx, cy, cz = np.float32(view.p_WC[0]), np.float32(view.p_WC[1]), np.float32(view.p_WC[2])
    dx = (px - cx) - (view.p_WC[0] - cx)
    dy = (py - cy) - (view.p_WC[1] - cy)
    dz = (pz - cz) - (view.p_WC[2] - cz)
    x, y, z = to_camera(R, (dx, dy, dz))
    ahead = (z > NEAR_M) & (lane_number() < left)
    if mask_bits(ahead) == 0:
        return staged
    s0, s1, s2 = columns_of_three(
        load_first(cloud.scales_m, 3 * first, 3 * left),
        load_first(cloud.scales_m, 3 * first + 16, 3 * left - 16),
        load_first(cloud.scales_m, 3 * first + 32, 3 * left - 32),
    )
    reach = maximum(maximum(s0, s1), s2) * REACH
    u_widest, v_widest = max(-lens.u_low, lens.u_high), max(-lens.v_low, lens.v_high)
    reach_x, reach_y = (
        reach * (lens.fx * math.sqrt(1.0 + u_widest * u_widest)),
        reach * (lens.fy * math.sqrt(1.0 + v_widest * v_widest)),
    )
    px, py = x * lens.fx, y * lens.fy
    opacity = load_first(cloud.opacities, first, left)
    seen = (
        ahead
        & (opacity >= ALPHA_MIN)
        & (fma(z, lens.cx + PAD_PX, px + reach_x) >= 0.0)
        & (fma(z, lens.x_last + 1.0 - lens.cx + PAD_PX, reach_x - px) >= 0.0)
        & (fma(z, lens.cy + PAD_PX, py + reach_y) >= 0.0)
        & (fma(z, lens.y_last + 1.0 - lens.cy + PAD_PX, reach_y - py) >= 0.0)
    )
    bits = mask_bits(seen)
    if bits == 0:
        return staged
    qw, qx, qy, qz = columns_of_four(
        load_first(cloud.quats_wxyz, 4 * first, 4 * left),
        load_first(cloud.quats_wxyz, 4 * first + 16, 4 * left - 16),
        load_first(cloud.quats_wxyz, 4 * first + 32, 4 * left - 32),
        load_first(cloud.quats_wxyz, 4 * first + 48, 4 * left - 48),
    )
    _stage(0, staged, seen, dx, kept)
    _stage(1, staged, seen, dy, kept)
    _stage(2, staged, seen, dz, kept)
    _stage(3, staged, seen, qw, kept)
    _stage(4, staged, seen, qx, kept)
    _stage(5, staged, seen, qy, kept)
    _stage(6, staged, seen, qz, kept)
    _stage(7, staged, seen, s0, kept)
    _stage(8, staged, seen, s1, kept)
    _stage(9, staged, seen, s2, kept)
    _stage(10, staged, seen, opacity, kept)
    _stage(11, staged, seen, float_of_bits(lane_number() + first), kept)
    size = count_bits(bits)
    for j in range(0, 3 * cloud.sh_count, 16):
        for lane in range(staged, staged + size):
            number = float_bits(kept.staged[(STAGED_ROWS - 1) * STAGED_LANES + lane])
            prefetch(cloud.sh, number * cloud.sh_stride + j)
    return staged + size


@inlined
def _staged(kept: Kept, row: int) -> Any:
    return load_f16(kept.staged, row * STAGED_LANES)


@inlined
def _image_block(lens: Lens, R: Any, staged: int, kept: Kept, ws: Workspace) -> int:
    """Project the first 16 staged Gaussians: their record rows go to the scratch memory, the visible lanes back."""
    x, y, z = to_camera(R, (_staged(kept, 0), _staged(kept, 1), _staged(kept, 2)))
    inverse_z = 1.0 / z
    u, v = x * inverse_z, y * inverse_z
    mean_x, mean_y = fma(u, lens.fx, lens.cx), fma(v, lens.fy, lens.cy)
    uc, vc = clamped(lens, u, v)
    Q = quaternion_matrix(_staged(kept, 3), _staged(kept, 4), _staged(kept, 5), _staged(kept, 6))
    A = image_axes(image_rows(R, uc, vc), Q)
    du, dv = inverse_z * lens.fx, inverse_z * lens.fy
    s0, s1, s2 = _staged(kept, 7), _staged(kept, 8), _staged(kept, 9)
    sxx, sxy, syy, det = image_covariance(
        (A[0] * s0 * du, A[1] * s1 * du, A[2] * s2 * du), (A[3] * s0 * dv, A[4] * s1 * dv, A[5] * s2 * dv)
    )
    log2_opacity = _log2(_staged(kept, 10))
    reach = maximum(fma(log2_opacity, LN_4, TWO_LN_255), 0.0)
    half_x, half_y = sqrt(reach * sxx), sqrt(reach * syy)
    left, top = mean_x - 0.5, mean_y - 0.5
    x0, x1 = maximum(ceil(left - half_x), 0.0), minimum(floor(left + half_x), lens.x_last)
    y0, y1 = maximum(ceil(top - half_y), 0.0), minimum(floor(top + half_y), lens.y_last)
    seen: int = mask_bits((lane_number() < staged) & (det > 0.0) & (det < np.inf) & (x0 <= x1) & (y0 <= y1))
    if seen:
        scale = LOG2_E / det
        store_f16(ws.scratch, 0, mean_x)
        store_f16(ws.scratch, 16, mean_y)
        store_f16(ws.scratch, 32, scale * syy * -0.5)
        store_f16(ws.scratch, 48, scale * sxy)
        store_f16(ws.scratch, 64, scale * sxx * -0.5)
        store_f16(ws.scratch, 80, log2_opacity)
        store_f16(ws.scratch, 144, z)
        store_f16(kept.coefficients, 57 * 16, maximum(half_x, half_y))
        first_x, last_x, first_y, last_y = truncate(x0) >> 2, truncate(x1) >> 2, truncate(y0) >> 2, truncate(y1) >> 2
        store_f16(ws.scratch, 16 * RECORD_BOUNDS_X, float_of_bits(first_x | (last_x << 16)))
        store_f16(ws.scratch, 16 * RECORD_BOUNDS_Y, float_of_bits(first_y | (last_y << 16)))
        store_i16(ws.scratch_bits, 0, box_codes(first_x, last_x, first_y, last_y, lens.columns))
        store_i16(ws.scratch_bits, 16, bit_pattern(z) - NEAR_BITS)
    return seen


@inlined
def _lanes(bits: int) -> Any:
    """M16 of the lowest 16 bits of an integer."""
    return has_bit(i16(1) << lane_number(), bits)


@inlined
def _keep(seen: int, records: int, cloud: Cloud, kept: Kept) -> None:
    """Append the visible lanes of the staged Gaussians to what the backward pass needs."""
    lanes = _lanes(seen)
    for row in range(STAGED_ROWS - 1):
        value = float_of_bits(compress(lanes, bit_pattern(_staged(kept, row))))
        store_f16(kept.rows, row * kept.stride + records, value)
    if cloud.sh_count:
        store_i16(kept.rows, COLOURED * kept.stride + records, compress(lanes, load_i16(kept.coefficients, 58 * 16)))
    if cloud.sh_count > 1:
        for row in range(STAGED_ROWS - 1, RADIUS):
            derivative = load_f16(kept.coefficients, (48 + row - STAGED_ROWS + 1) * 16)
            value = float_of_bits(compress(lanes, bit_pattern(derivative)))
            store_f16(kept.rows, row * kept.stride + records, value)


@inlined
def _emit(seen: int, records: int, columns: int, kept: Kept, ws: Workspace) -> int:
    """Append the visible lanes of the scratch memory to the records and their keys; the new number of both."""
    transpose_in_place(ws.scratch, 0)
    lanes = _lanes(seen)
    store_i16(kept.index, records, compress(lanes, bit_pattern(_staged(kept, STAGED_ROWS - 1))))
    radius = compress(lanes, bit_pattern(load_f16(kept.coefficients, 57 * 16)))
    store_f16(kept.rows, RADIUS * kept.stride + records, float_of_bits(radius))
    while seen:
        lane = lowest_bit(seen)
        seen &= seen - 1
        code, depth_bits = np.int64(ws.scratch_bits[lane]), np.int64(ws.scratch_bits[16 + lane])
        store_f16(ws.records, records * RECORD, load_f16(ws.scratch, lane * RECORD))
        ws.codes[records] = code
        ws.keys[records] = (depth_bits << 32) | records
        count_entries(ws, columns, code, records, 1)
        records += 1
    return records


@kernel
def project(view: View, cloud: Cloud, keep: bool, kept: Kept, ws: Workspace) -> None:
    """Cull and project all Gaussians, sixteen at a time.

    Args:
        view: Camera.
        cloud: Parameters.
        keep: Write what the backward pass needs.
        kept: Where to write that.
        ws: Workspace with room for all Gaussians.
    """
    lens, R = lens_of(view), rotation_rows(view.R_CW)
    ws.tile_count[:] = 0
    records, staged = 0, 0
    count = len(cloud.opacities)
    # One turn more than there are blocks: it projects the last ones that wait.
    for first in range(0, count + 16, 16):
        staged = _stage_block(view, lens, R, cloud, first, staged, kept)
        if staged >= 16 or (staged > 0 and first >= count):
            seen = _image_block(lens, R, staged, kept, ws)
            if seen:
                colour_block(cloud, kept, keep, seen, ws)
                if keep:
                    _keep(seen, records, cloud, kept)
                records = _emit(seen, records, lens.columns, kept, ws)
            for row in range(STAGED_ROWS):
                place = row * STAGED_LANES
                store_f16(kept.staged, place, load_f16(kept.staged, place + 16))
            staged -= 16
    ws.counts[RECORDS] = ws.counts[KEYS] = records
