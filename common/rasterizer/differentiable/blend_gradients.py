"""Backward blending: the tiles' lists are replayed front to back."""

from typing import Any

import numpy as np

from common.rasterizer.compilation import inlined, kernel
from common.rasterizer.constants import ALPHA_MAX
from common.rasterizer.cpu_blend import BATCH, LOG2_ALPHA_MIN, _exp2
from common.rasterizer.cpu_workspace import RECORD, RECORDS, Workspace
from common.rasterizer.differentiable.memory import (
    FEATURE_GROUP,
    GRADIENT_ROWS,
    PLANES,
    TRANSMITTANCE,
    Gradients,
    Raster,
    Singles,
)
from common.rasterizer.differentiable.simd_rows import lane_sums_at, lane_sums_of_eleven, load_block, store_block
from common.rasterizer.simd_memory import load_f16, load_i16, prefetch, store_f16
from common.rasterizer.simd_types import f16, fma, fnma, lane_number, lowest_bit, mask_bits, minimum, to_float, where

STATE_ROWS = PLANES + 2
"""Per block: transmittance, what is left behind, then the derivatives of the planes, that of transmittance negative."""
AHEAD = 16
"""Entries for which memory is asked in advance."""


@inlined
def _load_tile(raster: Raster, slopes: Singles, replay: Singles, left: int, top: int) -> None:
    """Set up the state of a tile's blocks."""
    size = raster.height * raster.stride
    planes = PLANES + raster.feature_count
    for block in range(16):
        pixel = (top + 4 * (block >> 2)) * raster.stride + left + 4 * (block & 3)
        place = block * (planes + 2) * 16
        store_f16(raster.state, place, load_block(replay, pixel, raster.stride))
        store_f16(raster.state, place + 16, load_block(replay, size + pixel, raster.stride))
        # The sum of weights is one minus the transmittance.
        store_f16(raster.state, place + 32, 0.0 - load_block(slopes, TRANSMITTANCE * size + pixel, raster.stride))
        for plane in range(1, planes):
            store_f16(raster.state, place + 32 + 16 * plane, load_block(slopes, plane * size + pixel, raster.stride))


@inlined
def _store_tile(raster: Raster, replay: Singles, left: int, top: int) -> None:
    """Keep transmittance and what is left behind for the next slab."""
    size = raster.height * raster.stride
    for block in range(16):
        pixel = (top + 4 * (block >> 2)) * raster.stride + left + 4 * (block & 3)
        place = block * (STATE_ROWS + raster.feature_count) * 16
        store_block(replay, pixel, raster.stride, load_f16(raster.state, place))
        store_block(replay, size + pixel, raster.stride, load_f16(raster.state, place + 16))


@kernel
def begin_replay(ws: Workspace, raster: Raster, slopes: Singles, replay: Singles, out: Gradients) -> None:
    """Start with full transmittance, the whole image left behind, and no derivatives.

    Args:
        ws: Workspace after the last slab.
        raster: Finished planes.
        slopes: Derivatives of the loss by the planes, laid out as these.
        replay: Two planes: transmittance, and the sum of slopes times what the entries to come add to the planes.
        out: Its gradient records are set to 0.
    """
    size = raster.height * raster.stride
    for p in range(0, size, 16):
        store_f16(replay, p, f16(1.0))
        behind = load_f16(slopes, p) * (load_f16(raster.planes, p) - 1.0)
        for plane in range(1, PLANES + raster.feature_count):
            behind = fma(load_f16(slopes, plane * size + p), load_f16(raster.planes, plane * size + p), behind)
        store_f16(replay, size + p, behind)
    for k in range(0, ws.counts[RECORDS] * out.record_size, 16):
        store_f16(out.records, k, f16(0.0))


@inlined
def _feature_slopes(raster: Raster, place: int, record: int, slope: Any) -> Any:
    """Add the record's features times the derivatives by the feature planes."""
    state, features = raster.state, raster.features
    for group in range(0, raster.feature_count, FEATURE_GROUP):
        p, r = place + 16 * (STATE_ROWS + group), record * raster.feature_count + group
        slope = fma(load_f16(state, p), features[r], slope)
        slope = fma(load_f16(state, p + 16), features[r + 1], slope)
        slope = fma(load_f16(state, p + 32), features[r + 2], slope)
        slope = fma(load_f16(state, p + 48), features[r + 3], slope)
    return slope


@inlined
def _add_feature_sums(raster: Raster, place: int, weight: Any, out: Gradients) -> None:
    for k in range(raster.feature_count):
        p = (GRADIENT_ROWS + k) * 16
        slope = load_f16(raster.state, place + 16 * (STATE_ROWS + k))
        store_f16(out.sums, p, fma(weight, slope, load_f16(out.sums, p)))


@inlined
def _begin_sums(out: Gradients, used: int) -> None:
    for k in range(GRADIENT_ROWS, used):
        store_f16(out.sums, k * 16, f16(0.0))


@inlined
def _replay_entry(
    ws: Workspace, raster: Raster, record: int, bits: int, left: int, top: int, with_depth: bool, absolute: bool, out: Gradients
) -> None:
    """Draw one record into its blocks once more, and add its derivatives.

    Args:
        ws: Workspace.
        raster: State of the tile.
        record: Number of the record.
        bits: Blocks of the tile.
        left: First column of the tile [px].
        top: First row of the tile [px].
        with_depth: The loss depends on the depth plane.
        absolute: Sum up absolute derivatives by the mean as well.
        out: Where to add.
    """
    state, records, r = raster.state, ws.records, record * RECORD
    rows = STATE_ROWS + raster.feature_count
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    corner_x, corner_y = lane_x + (np.float32(left) - records[r]), lane_y + (np.float32(top) - records[r + 1])
    a, b, c, log2_opacity = f16(records[r + 2]), f16(records[r + 3]), f16(records[r + 4]), f16(records[r + 5])
    red, green, blue, depth = f16(records[r + 6]), f16(records[r + 7]), f16(records[r + 8]), f16(records[r + 9])
    zero = f16(0.0)
    m0, m1, m2, m3, m4, m5, total = zero, zero, zero, zero, zero, zero, zero
    sum_red, sum_green, sum_blue, sum_depth = zero, zero, zero, zero
    extra = raster.feature_count > 0 or absolute
    used = GRADIENT_ROWS + raster.feature_count
    if extra:
        _begin_sums(out, out.record_size)
    while bits:
        block = lowest_bit(bits)
        bits &= bits - 1
        place = block * rows * 16
        dx, dy = corner_x + raster.block_x[block], corner_y + raster.block_y[block]
        t = fma(dx, fma(dx, a, dy * b), fma(dy * c, dy, log2_opacity))
        drawn = t >= LOG2_ALPHA_MIN
        uncapped = _exp2(t)
        alpha = where(drawn, minimum(uncapped, ALPHA_MAX), 0.0)
        transmittance = load_f16(state, place)
        weight = alpha * transmittance
        slope_red, slope_green = load_f16(state, place + 48), load_f16(state, place + 64)
        slope_blue = load_f16(state, place + 80)
        slope = fma(red, slope_red, fma(green, slope_green, fma(blue, slope_blue, load_f16(state, place + 32))))
        if with_depth:
            slope_depth = load_f16(state, place + 96)
            slope = fma(depth, slope_depth, slope)
            sum_depth = fma(weight, slope_depth, sum_depth)
        if raster.feature_count:
            slope = _feature_slopes(raster, place, record, slope)
            _add_feature_sums(raster, place, weight, out)
        behind = fnma(weight, slope, load_f16(state, place + 16))
        # Derivative by the logarithm of alpha.
        v = fma(weight, slope, behind * (alpha / (alpha - 1.0)))
        v = where(uncapped < ALPHA_MAX, v, 0.0)
        vx, vy = v * dx, v * dy
        m0, m1, m2 = m0 + v, m1 + vx, m2 + vy
        m3, m4, m5 = fma(vx, dx, m3), fma(vx, dy, m4), fma(vy, dy, m5)
        sum_red, sum_green = fma(weight, slope_red, sum_red), fma(weight, slope_green, sum_green)
        sum_blue, total = fma(weight, slope_blue, sum_blue), total + weight
        store_f16(state, place, fnma(alpha, transmittance, transmittance))
        store_f16(state, place + 16, behind)
        if absolute:
            _add_absolute(used, fma(vx, a * 2.0, vy * b), fma(vx, b, vy * (c * 2.0)), out)
    if extra:
        _add_rows(record, (m0, m1, m2, m3, m4, m5, total, sum_red, sum_green, sum_blue, sum_depth), out)
    else:
        place = record * out.record_size
        sums = lane_sums_of_eleven(m0, m1, m2, m3, m4, m5, total, sum_red, sum_green, sum_blue, sum_depth)
        store_f16(out.records, place, load_f16(out.records, place) + sums)


@inlined
def _add_absolute(used: int, x: Any, y: Any, out: Gradients) -> None:
    p = used * 16
    store_f16(out.sums, p, load_f16(out.sums, p) + where(x >= 0.0, x, 0.0 - x))
    store_f16(out.sums, p + 16, load_f16(out.sums, p + 16) + where(y >= 0.0, y, 0.0 - y))


@inlined
def _add_rows(record: int, sums: Any, out: Gradients) -> None:
    """Add a gradient record of any size; its first rows come in `sums`, the others are in memory."""
    store_f16(out.sums, 0, sums[0])
    store_f16(out.sums, 16, sums[1])
    store_f16(out.sums, 32, sums[2])
    store_f16(out.sums, 48, sums[3])
    store_f16(out.sums, 64, sums[4])
    store_f16(out.sums, 80, sums[5])
    store_f16(out.sums, 96, sums[6])
    store_f16(out.sums, 112, sums[7])
    store_f16(out.sums, 128, sums[8])
    store_f16(out.sums, 144, sums[9])
    store_f16(out.sums, 160, sums[10])
    for k in range(0, out.record_size, 16):
        place = record * out.record_size + k
        store_f16(out.records, place, load_f16(out.records, place) + lane_sums_at(out.sums, k * 16))


@kernel
def blend_gradients(
    width: int,
    ws: Workspace,
    raster: Raster,
    slopes: Singles,
    replay: Singles,
    with_depth: bool,
    absolute: bool,
    out: Gradients,
) -> None:
    """Derivatives of the loss by what the records of one slab hold; slabs are replayed in their order.

    Args:
        width: Columns of the image.
        ws: Workspace with the lists of the slab.
        raster: What the slab's `blend` noted.
        slopes: Derivatives of the loss by the planes.
        replay: See `begin_replay`.
        with_depth: Derivatives by the depth plane are not all zero.
        absolute: Sum up the absolute values of each pixel's derivatives by the projected mean, in log2 units, after
            the features' sums.
        out: Gradient records are added to.
    """
    columns = (width + 15) >> 4
    for tile in range(len(ws.tile_start) - 1):
        entry, end = ws.tile_start[tile], ws.tile_start[tile + 1] - 1
        alive = mask_bits(load_i16(raster.block_end, tile * 16) > entry)
        if entry >= end or alive == 0:
            continue
        left, top = (tile % columns) * 16, (tile // columns) * 16
        _load_tile(raster, slopes, replay, left, top)
        while entry < end and alive:
            for i in range(entry, min(entry + BATCH, end)):
                ahead = np.int64(ws.entry_record[min(i + AHEAD, end - 1)])
                prefetch(ws.records, ahead * RECORD)
                prefetch(out.records, ahead * out.record_size)
                bits = np.int64(ws.entry_blocks[i]) & alive
                if bits:
                    record = np.int64(ws.entry_record[i])
                    _replay_entry(ws, raster, record, bits, left, top, with_depth, absolute, out)
            entry += BATCH
            alive = mask_bits(load_i16(raster.block_end, tile * 16) > entry)
        _store_tile(raster, replay, left, top)
