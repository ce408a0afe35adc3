"""Backward blending: the tiles' lists are replayed front to back."""

from typing import Any, NamedTuple

import numpy as np

from readygo.common.kernels import inlined
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.blend import log2_alpha
from readygo.common.rasterizer.cpu.workspace import NODE, RECORD, RECORDS, Workspace
from readygo.common.rasterizer.differentiable.blend import exp2
from readygo.common.rasterizer.differentiable.memory import (
    FEATURE_GROUP,
    LATER_ROWS,
    PLANES,
    TRANSMITTANCE,
    Gradients,
    Raster,
    Singles,
)
from readygo.common.rasterizer.differentiable.released import released
from readygo.common.rasterizer.differentiable.simd_rows import (
    lane_sums_at,
    lane_sums_of_eleven,
    lane_sums_of_fifteen,
    load_block,
    store_block,
)
from readygo.common.simd.memory import load_f16, load_i16, prefetch, store_f16
from readygo.common.simd.types import f16, fma, fnma, lane_number, lowest_bit, mask_bits, minimum, to_float, where

STATE_ROWS = PLANES + 2
"""Per block: transmittance, what is left behind, then the derivatives of the planes, that of transmittance negative."""
AHEAD = 16
"""Entries for which memory is asked in advance."""


class Options(NamedTuple):
    """What is wanted of the derivatives."""

    with_depth: bool
    """Derivatives by the depth plane are not all zero."""
    absolute: bool
    """Sum up the absolute values of each pixel's derivatives by the projected mean as well, in log2 units."""
    absolute_row: int
    """Where these are in a gradient record, behind the features."""


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


@released
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
def _later_features(raster: Raster, place: int, record: int, slope: Any) -> Any:
    """Add the record's features beyond the first group times the derivatives by their planes."""
    state, features = raster.state, raster.features
    for k in range(FEATURE_GROUP, raster.feature_count):
        value = features[record * raster.feature_count + k]
        slope = fma(load_f16(state, place + 16 * (STATE_ROWS + k)), value, slope)
    return slope


@inlined
def _add_later_features(raster: Raster, place: int, weight: Any, out: Gradients) -> None:
    for k in range(FEATURE_GROUP, raster.feature_count):
        p = (LATER_ROWS + k - FEATURE_GROUP) * 16
        slope = load_f16(raster.state, place + 16 * (STATE_ROWS + k))
        store_f16(out.sums, p, fma(weight, slope, load_f16(out.sums, p)))


@inlined
def _add_absolute(row: int, x: Any, y: Any, out: Gradients) -> None:
    p = row * 16
    store_f16(out.sums, p, load_f16(out.sums, p) + where(x >= 0.0, x, 0.0 - x))
    store_f16(out.sums, p + 16, load_f16(out.sums, p + 16) + where(y >= 0.0, y, 0.0 - y))


@inlined
def _replay_entry(
    ws: Workspace, raster: Raster, record: int, bits: int, left: int, top: int, options: Options, out: Gradients
) -> None:
    """Draw one record into its blocks once more, and add its derivatives.

    Args:
        ws: Workspace.
        raster: State of the tile.
        record: Number of the record.
        bits: Blocks of the tile.
        left: First column of the tile [px].
        top: First row of the tile [px].
        options: What is wanted.
        out: Where to add.
    """
    state, records, r, features = raster.state, ws.records, record * RECORD, raster.features
    rows, f = STATE_ROWS + raster.feature_count, record * raster.feature_count
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    corner_x, corner_y = lane_x + (np.float32(left) - records[r]), lane_y + (np.float32(top) - records[r + 1])
    a, b, c, log2_opacity = f16(records[r + 2]), f16(records[r + 3]), f16(records[r + 4]), f16(records[r + 5])
    red, green, blue, depth = f16(records[r + 6]), f16(records[r + 7]), f16(records[r + 8]), f16(records[r + 9])
    zero = f16(0.0)
    m0, m1, m2, m3, m4, m5, total = zero, zero, zero, zero, zero, zero, zero
    sum_red, sum_green, sum_blue, sum_depth = zero, zero, zero, zero
    f0, f1, f2, f3 = zero, zero, zero, zero
    for k in range(LATER_ROWS, out.record_size):
        store_f16(out.sums, k * 16, zero)
    while bits:
        block = lowest_bit(bits)
        bits &= bits - 1
        place = block * rows * 16
        dx, dy = corner_x + raster.block_x[block], corner_y + raster.block_y[block]
        t = log2_alpha(dx, dy, a, b, c, log2_opacity)
        uncapped = exp2(t)
        transmittance = load_f16(state, place)
        drawn = (t >= LOG2_ALPHA_MIN) & (transmittance >= TRANSMITTANCE_MIN)
        alpha = where(drawn, minimum(uncapped, ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        slope_red, slope_green = load_f16(state, place + 48), load_f16(state, place + 64)
        slope_blue = load_f16(state, place + 80)
        slope = fma(red, slope_red, fma(green, slope_green, fma(blue, slope_blue, load_f16(state, place + 32))))
        sum_red, sum_green = fma(weight, slope_red, sum_red), fma(weight, slope_green, sum_green)
        sum_blue, total = fma(weight, slope_blue, sum_blue), total + weight
        if options.with_depth:
            slope_depth = load_f16(state, place + 96)
            slope, sum_depth = fma(depth, slope_depth, slope), fma(weight, slope_depth, sum_depth)
        if raster.feature_count:
            s0, s1 = load_f16(state, place + 112), load_f16(state, place + 128)
            s2, s3 = load_f16(state, place + 144), load_f16(state, place + 160)
            slope = fma(s0, features[f], fma(s1, features[f + 1], slope))
            slope = fma(s2, features[f + 2], fma(s3, features[f + 3], slope))
            f0, f1, f2, f3 = fma(weight, s0, f0), fma(weight, s1, f1), fma(weight, s2, f2), fma(weight, s3, f3)
            slope = _later_features(raster, place, record, slope)
            _add_later_features(raster, place, weight, out)
        behind = fnma(weight, slope, load_f16(state, place + 16))
        # Derivative by the logarithm of alpha.
        v = fma(weight, slope, behind * (alpha / (alpha - 1.0)))
        v = where(uncapped < ALPHA_MAX, v, 0.0)
        vx, vy = v * dx, v * dy
        m0, m1, m2 = m0 + v, m1 + vx, m2 + vy
        m3, m4, m5 = fma(vx, dx, m3), fma(vx, dy, m4), fma(vy, dy, m5)
        store_f16(state, place, transmittance - weight)
        store_f16(state, place + 16, behind)
        if options.absolute:
            _add_absolute(options.absolute_row, fma(vx, a * 2.0, vy * b), fma(vx, b, vy * (c * 2.0)), out)
    place = record * out.record_size
    sums = (m0, m1, m2, m3, m4, m5, total, sum_red, sum_green, sum_blue, sum_depth)
    first = lane_sums_of_fifteen(sums, (f0, f1, f2, f3)) if raster.feature_count else lane_sums_of_eleven(sums)
    store_f16(out.records, place, load_f16(out.records, place) + first)
    for k in range(LATER_ROWS, out.record_size, 16):
        store_f16(out.records, place + k, load_f16(out.records, place + k) + lane_sums_at(out.sums, k * 16))


@released
def blend_gradients(
    width: int,
    ws: Workspace,
    raster: Raster,
    slopes: Singles,
    replay: Singles,
    options: Options,
    out: Gradients,
) -> None:
    """Derivatives of the loss by what the records of one slab hold; slabs are replayed in their order.

    Args:
        width: Columns of the image.
        ws: Workspace with the lists of the slab.
        raster: What the slab's `blend` noted.
        slopes: Derivatives of the loss by the planes.
        replay: See `begin_replay`.
        options: What is wanted.
        out: Gradient records are added to.
    """
    columns = (width + 15) >> 4
    for tile in range(len(ws.quad_alive)):
        last_place = ws.tile_place[tile]
        alive = mask_bits(load_i16(raster.block_end, tile * 16) > 0)
        if last_place == tile * NODE or alive == 0:
            continue
        left, top = (tile % columns) * 16, (tile // columns) * 16
        _load_tile(raster, slopes, replay, left, top)
        node, last, drawn = tile, last_place >> 6, 0
        size = NODE
        while alive and size == NODE:
            if node == last:
                size = last_place & (NODE - 1)
            for i in range(node * NODE, node * NODE + size):
                ahead = np.int64(ws.entry_record[min(i + AHEAD, node * NODE + size - 1)])
                prefetch(ws.records, ahead * RECORD)
                prefetch(out.records, ahead * out.record_size)
                if raster.feature_count:
                    prefetch(raster.features, ahead * raster.feature_count)
                bits = np.int64(ws.entry_blocks[i]) & alive
                if bits:
                    record = np.int64(ws.entry_record[i])
                    _replay_entry(ws, raster, record, bits, left, top, options, out)
            drawn += 1
            alive = mask_bits(load_i16(raster.block_end, tile * 16) > drawn)
            if node != last:
                node = ws.node_next[node]
        _store_tile(raster, replay, left, top)
