"""From parameters in any order to records, keys and counts per tile.

Legend as in `project_gradients`; a group is projected at a time, one Gaussian per lane. Its rows come from the arrays
of parameters by a transpose: 16 rows of offset, quaternion, scales, opacity and number become one row per number.
"""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import ALPHA_MIN, LOG2_E
from readygo.common.rasterizer.cpu.blend import EXPONENT_BIT, begin_slab
from readygo.common.rasterizer.cpu.optics import Optics, clamp_tangents, optics_of, rotation_rows
from readygo.common.rasterizer.cpu.project import pixels_within
from readygo.common.rasterizer.cpu.slabs import NEAR_BITS, Slab, is_due
from readygo.common.rasterizer.cpu.tiles import LARGE, box_codes, is_alive, tiles_met
from readygo.common.rasterizer.cpu.view import PinholeView
from readygo.common.rasterizer.cpu.workspace import (
    BITS_DEPTH,
    BITS_HIGH,
    BITS_LOW,
    BITS_TILE,
    BLOCK_BITS,
    BOX,
    DEPTH_SHIFT,
    KEYS,
    LARGE_ENTRIES,
    LATER,
    RECORD,
    RECORD_A,
    RECORD_B,
    RECORD_C,
    RECORD_DEPTH,
    RECORD_OPACITY,
    RECORD_X,
    RECORD_Y,
    RECORDS,
    Workspace,
)
from readygo.common.simd.memory import (
    load_f16,
    peek,
    poke,
    prefetch,
    store_f16,
    store_i16,
    transpose,
)
from readygo.common.simd.types import (
    LANES,
    bit_pattern,
    float_bits,
    float_of_bits,
    float_with_bits,
    fma,
    has_bit,
    i16,
    lane_number,
    lowest_bit,
    mask_bits,
    maximum,
    sqrt,
    to_float,
    where,
)
from readygo.services.reconstructor.differentiable.colour import colour_group
from readygo.services.reconstructor.differentiable.cull import BLOCKS, from_camera
from readygo.services.reconstructor.differentiable.ewa import (
    image_axes,
    image_covariance,
    image_rows,
    quaternion_matrix,
    to_camera,
)
from readygo.services.reconstructor.differentiable.memory import (
    CHUNK,
    GROUP,
    NUMBER,
    OFFSET,
    OPACITY,
    QUATERNION,
    RADIUS,
    SCALES,
    Chunks,
    Cloud,
    ForwardMemory,
)
from readygo.services.reconstructor.differentiable.released import kernel_without_gil
from readygo.services.reconstructor.differentiable.simd_rows import copy_four, copy_three

LN_4 = 2.0 * math.log(2.0)
TWO_LN_255 = -2.0 * math.log(ALPHA_MIN)
TWO_THIRDS_BITS = 0x3F2AAAAB
"""The bits of the float32 nearest to 2/3."""


@inline_kernel
def _log2(x: Any) -> Any:
    """Binary logarithm of positive normal numbers, absolute error below 2e-7: a series of artanh((m - 1) / (m + 1))."""
    # x = (m + 1) 2^exponent with m + 1 in 2/3..4/3; with s = m / (m + 2), ln(m + 1) = 2 (s + s^3 / 3 + s^5 / 5 + ..).
    exponent = (bit_pattern(x) - TWO_THIRDS_BITS) >> EXPONENT_BIT
    m = float_of_bits(bit_pattern(x) - (exponent << EXPONENT_BIT)) - 1.0
    s = m / (m + 2.0)
    ss = s * s
    p = fma(ss, fma(ss, fma(ss, fma(ss, 2.0 / 9.0, 2.0 / 7.0), 2.0 / 5.0), 2.0 / 3.0), 2.0)
    return fma(s * p, LOG2_E, to_float(exponent))


@inline_kernel
def _list_waiting(chunks: Chunks, i: int, kept: ForwardMemory) -> int:
    """Write the numbers of the Gaussians of chunk `i` that may touch the image, and return how many they are."""
    count = 0
    for block in range(BLOCKS):
        first = chunks.number[i] * CHUNK + LANES * block
        lanes = peek(chunks.lanes, BLOCKS * i + block)
        while lanes:
            poke(kept.waiting, count, first + lowest_bit(lanes))
            lanes &= lanes - 1
            count += 1
    return count


@inline_kernel
def _row(kept: ForwardMemory, group: int, row: int) -> Any:
    """A row of a group, see `GROUP_ROWS`."""
    return load_f16(kept.groups, group * GROUP + LANES * row)


@inline_kernel
def _gather_group(view: PinholeView, cloud: Cloud, begin: int, size: int, group: int, kept: ForwardMemory) -> None:
    """Bring the parameters of `size` of the waiting Gaussians to a group, those from `begin` on."""
    for lane in range(size):
        number, row = peek(kept.waiting, begin + lane), LANES * lane
        for j in range(0, 3 * cloud.sh_count, LANES):
            prefetch(cloud.sh, number * cloud.sh_stride + j)
        copy_three(kept.rows, row + OFFSET, cloud.means_m, 3 * number)
        copy_four(kept.rows, row + QUATERNION, cloud.quats_wxyz, 4 * number)
        copy_three(kept.rows, row + SCALES, cloud.scales_m, 3 * number)
        poke(kept.rows, row + OPACITY, peek(cloud.opacities, number))
        poke(kept.rows, row + NUMBER, float_with_bits(number))
    place = group * GROUP
    transpose(kept.rows, 0, LANES, kept.groups, place, LANES)
    # Means become offsets from the camera, axis by axis.
    store_f16(kept.groups, place, from_camera(view, 0, load_f16(kept.groups, place)))
    store_f16(kept.groups, place + LANES, from_camera(view, 1, load_f16(kept.groups, place + LANES)))
    store_f16(kept.groups, place + 2 * LANES, from_camera(view, 2, load_f16(kept.groups, place + 2 * LANES)))
    kept.lanes[group] = size


@inline_kernel
def _image_group(optics: Optics, R: Any, group: int, kept: ForwardMemory, ws: Workspace) -> int:
    """Project a group: its record rows go to the scratch memory, the lanes that cover a pixel centre back."""
    d = (_row(kept, group, OFFSET), _row(kept, group, OFFSET + 1), _row(kept, group, OFFSET + 2))
    x, y, z = to_camera(R, d)
    inverse_z = 1.0 / z
    u, v = x * inverse_z, y * inverse_z
    mean_x, mean_y = fma(u, optics.fx, optics.cx), fma(v, optics.fy, optics.cy)
    uc, vc = clamp_tangents(optics, u, v)
    q0, q1 = _row(kept, group, QUATERNION), _row(kept, group, QUATERNION + 1)
    q2, q3 = _row(kept, group, QUATERNION + 2), _row(kept, group, QUATERNION + 3)
    Q = quaternion_matrix(q0, q1, q2, q3)
    A = image_axes(image_rows(R, uc, vc), Q)
    du, dv = inverse_z * optics.fx, inverse_z * optics.fy
    s0, s1, s2 = _row(kept, group, SCALES), _row(kept, group, SCALES + 1), _row(kept, group, SCALES + 2)
    sxx, sxy, syy, det = image_covariance(
        (A[0] * s0 * du, A[1] * s1 * du, A[2] * s2 * du), (A[3] * s0 * dv, A[4] * s1 * dv, A[5] * s2 * dv)
    )
    # Squared distance in sigmas at which alpha falls to 1/255: 2 ln(255 opacity).
    log2_opacity = _log2(_row(kept, group, OPACITY))
    reach = maximum(fma(log2_opacity, LN_4, TWO_LN_255), 0.0)
    # As in `cpu.project`: the bounding box of that ellipse, and log2(alpha) as a quadratic form.
    half_x, half_y = sqrt(reach * sxx), sqrt(reach * syy)
    left, top = mean_x - 0.5, mean_y - 0.5
    x0, x1, in_columns = pixels_within(left - half_x, left + half_x, optics.x_last)
    y0, y1, in_rows = pixels_within(top - half_y, top + half_y, optics.y_last)
    valid = (lane_number() < np.int64(kept.lanes[group])) & (det > 0.0) & (det < np.inf)
    seen: int = mask_bits(valid & in_columns & in_rows)
    scale = LOG2_E / det
    store_f16(ws.scratch, LANES * RECORD_X, mean_x)
    store_f16(ws.scratch, LANES * RECORD_Y, mean_y)
    store_f16(ws.scratch, LANES * RECORD_A, scale * syy * -0.5)
    store_f16(ws.scratch, LANES * RECORD_B, scale * sxy)
    store_f16(ws.scratch, LANES * RECORD_C, scale * sxx * -0.5)
    store_f16(ws.scratch, LANES * RECORD_OPACITY, log2_opacity)
    store_f16(ws.scratch, LANES * RECORD_DEPTH, z)
    tile, low, high = box_codes(x0 >> BLOCK_BITS, x1 >> BLOCK_BITS, y0 >> BLOCK_BITS, y1 >> BLOCK_BITS, optics.columns)
    store_i16(ws.scratch_bits, BITS_TILE, tile)
    store_i16(ws.scratch_bits, BITS_LOW, low)
    store_i16(ws.scratch_bits, BITS_HIGH, high)
    store_i16(ws.scratch_bits, BITS_DEPTH, bit_pattern(z) - NEAR_BITS)
    store_f16(kept.groups, group * GROUP + LANES * RADIUS, maximum(half_x, half_y))
    return seen


@inline_kernel
def _box(lane: int, ws: Workspace) -> Any:
    """First tile and blocks of a lane's box, see `tiles`."""
    bits = ws.scratch_bits
    low, high = np.int64(peek(bits, BITS_LOW + lane)), np.int64(peek(bits, BITS_HIGH + lane))
    return np.int64(peek(bits, BITS_TILE + lane)), (low & 0xFFFFFFFF) | (high << 32)


@inline_kernel
def _unhidden(seen: int, columns: int, ws: Workspace) -> int:
    """Those of the seen lanes whose box meets pixels that are not finished."""
    alive, waiting = 0, seen
    while waiting:
        lane = lowest_bit(waiting)
        waiting &= waiting - 1
        tile, blocks = _box(lane, ws)
        alive |= is_alive(ws, columns, tile, blocks) << lane
    return alive


@inline_kernel
def _emit(drawn: int, first: int, counts: tuple[int, int], slab: Slab, ws: Workspace) -> tuple[int, int]:
    """Write the records of a group, the first of which is `first`, and append keys to this slab's or the later ones.

    Args:
        drawn: Lanes that are drawn.
        first: Number of the first record.
        counts: Numbers of this slab's keys and of later keys.
        slab: Depths that are drawn now.
        ws: Workspace.

    Returns:
        The new counts.
    """
    # From one row per number to one row per Gaussian.
    transpose(ws.scratch, 0, LANES, ws.records, first * RECORD, RECORD)
    keys, later = counts
    while drawn:
        lane = lowest_bit(drawn)
        drawn &= drawn - 1
        record = first + lane
        tile, blocks = _box(lane, ws)
        depth_bits = np.int64(peek(ws.scratch_bits, BITS_DEPTH + lane))
        if tile == LARGE:
            ws.counts[LARGE_ENTRIES] += tiles_met(blocks)
        poke(ws.boxes, BOX * record, tile)
        poke(ws.boxes, BOX * record + 1, blocks)
        # Written in any case, counted if true: cheaper than branches that the CPU cannot foresee.
        due = 1 if depth_bits < slab.limit_bits else 0
        key = (depth_bits << DEPTH_SHIFT) | record
        poke(ws.keys, keys, key)
        poke(ws.later, later, key)
        keys += due
        later += 1 - due
    return keys, later


@kernel_without_gil
def project(
    view: PinholeView, cloud: Cloud, chunks: Chunks, slab: Slab, keep: bool, kept: ForwardMemory, ws: Workspace
) -> None:
    """Begin a slab: project its chunks, and append the Gaussians that touch unfinished pixels.

    Args:
        view: Camera.
        cloud: Parameters.
        chunks: Chunks that may be seen.
        slab: Depths that are drawn now.
        keep: Prepare for the backward pass.
        kept: Where the groups are written.
        ws: Workspace with room for all Gaussians of these chunks.
    """
    begin_slab(view.width, slab.limit_bits, ws)
    optics, R = optics_of(view), rotation_rows(view.R_CW)
    group = ws.counts[RECORDS] >> 4
    counts = (ws.counts[KEYS], ws.counts[LATER])
    for i in range(len(chunks.number)):
        if not is_due(slab, chunks.depth_m[i], chunks.box[i], optics.columns, ws.tile_alive):
            continue
        chunks.first_group[i] = group
        waiting = _list_waiting(chunks, i, kept)
        for begin in range(0, waiting, LANES):
            _gather_group(view, cloud, begin, min(waiting - begin, LANES), group, kept)
            drawn = _image_group(optics, R, group, kept, ws)
            if slab.cull:
                drawn = _unhidden(drawn, optics.columns, ws)
            if drawn:
                radius = group * GROUP + LANES * RADIUS
                store_f16(kept.groups, radius, where(_lanes(drawn), load_f16(kept.groups, radius), 0.0))
                colour_group(cloud, group, drawn, keep, kept, ws)
                counts = _emit(drawn, LANES * group, counts, slab, ws)
                group += 1
        chunks.group_count[i] = group - chunks.first_group[i]
    ws.counts[RECORDS] = LANES * group
    ws.counts[KEYS], ws.counts[LATER] = counts


@inline_kernel
def _lanes(bits: int) -> Any:
    """M16 of the lowest 16 bits of an integer."""
    return has_bit(i16(1) << lane_number(), bits)


@kernel_without_gil
def list_drawn(chunks: Chunks, kept: ForwardMemory, index: Int64Array, radius_px: Float32Array) -> int:
    """Write numbers and radii of all Gaussians of the groups in the order of memory, and return their number."""
    n = 0
    for i in range(len(chunks.number)):
        for group in range(chunks.first_group[i], chunks.first_group[i] + chunks.group_count[i]):
            place = group * GROUP
            for lane in range(kept.lanes[group]):
                poke(index, n, float_bits(peek(kept.groups, place + LANES * NUMBER + lane)))
                poke(radius_px, n, peek(kept.groups, place + LANES * RADIUS + lane))
                n += 1
    return n
