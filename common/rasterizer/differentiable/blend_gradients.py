"""Backward blending: the tiles' lists are replayed front to back."""

from typing import Any

import numpy as np

from readygo.common.kernels import inlined
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.blend import log2_alpha
from readygo.common.rasterizer.cpu.workspace import NODE, RECORD, RECORDS, Workspace
from readygo.common.rasterizer.differentiable.blend import exp2
from readygo.common.rasterizer.differentiable.memory import (
    FEATURE_GROUP,
    FEATURES,
    PLANES,
    TRANSMITTANCE,
    Gradients,
    Raster,
    Singles,
)
from readygo.common.rasterizer.differentiable.released import released
from readygo.common.rasterizer.differentiable.simd_rows import (
    add_block_sums,
    load_block,
    store_block,
    sums_over_columns,
    sums_over_rows,
)
from readygo.common.simd.memory import load_f16, peek, poke, prefetch, store_f16
from readygo.common.simd.types import f16, fma, lane_number, lowest_bit, maximum, minimum, to_float, where

STATE_ROWS = PLANES + 2
"""Per block: transmittance, what is left behind, then the derivatives of the planes, that of transmittance negative."""


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
    """Start with full transmittance, the whole image left behind, and no record replayed.

    Args:
        ws: Workspace after the last slab.
        raster: Finished planes.
        slopes: Derivatives of the loss by the planes, laid out as these.
        replay: Two planes: transmittance, and the sum of slopes times what the entries to come add to the planes.
        out: No group of it is touched.
    """
    size = raster.height * raster.stride
    for p in range(0, size, 16):
        store_f16(replay, p, f16(1.0))
        behind = load_f16(slopes, p) * (load_f16(raster.planes, p) - 1.0)
        for plane in range(1, PLANES + raster.feature_count):
            behind = fma(load_f16(slopes, plane * size + p), load_f16(raster.planes, plane * size + p), behind)
        store_f16(replay, size + p, behind)
    for group in range(ws.counts[RECORDS] >> 4):
        out.touched[group] = 0


@inlined
def _touch(ws: Workspace, raster: Raster, entry: int, out: Gradients) -> None:
    """Set the gradient records of groups to 0 that a node's entries are the first to need."""
    drawing = 0
    for block in range(16):
        drawing |= peek(raster.node_blocks, (entry >> 2) + block)
    while drawing:
        group = np.int64(peek(ws.entry_record, entry + lowest_bit(drawing))) >> 4
        drawing &= drawing - 1
        if peek(out.touched, group) == 0:
            poke(out.touched, group, 1)
            first = group * 16 * out.record_size
            for k in range(first, first + 16 * out.record_size, 16):
                store_f16(out.records, k, f16(0.0))


@inlined
def _replay_features(raster: Raster, place: int, record: int, weight: Any, gain: Any, out: Gradients) -> Any:
    """Add a record's features to what it gives the loss, and their derivatives to its gradient record."""
    state, features = raster.state, raster.features
    for group in range(0, raster.feature_count, FEATURE_GROUP):
        p, f = place + 16 * (STATE_ROWS + group), record * raster.feature_count + group
        a, b = weight * load_f16(state, p), weight * load_f16(state, p + 16)
        c, d = weight * load_f16(state, p + 32), weight * load_f16(state, p + 48)
        gain = fma(peek(features, f), a, fma(peek(features, f + 1), b, gain))
        gain = fma(peek(features, f + 2), c, fma(peek(features, f + 3), d, gain))
        add_block_sums(out.records, record * out.record_size + FEATURES + group, a, b, c, d)
    return gain


@inlined
def _magnitude(x: Any) -> Any:
    return maximum(x, 0.0 - x)


@inlined
def _replay_block(
    ws: Workspace, raster: Raster, place: int, entry: int, drawing: int, x: Any, y: Any, absolute: bool, out: Gradients
) -> None:
    """Draw those of a node's entries whose bit is set into a 4x4 block of pixels once more, and add their derivatives.

    Args:
        ws: Workspace.
        raster: State of the tile.
        place: Where the block's state begins.
        entry: First entry of the node.
        drawing: A bit per entry.
        x: Pixel centres [px].
        y: See `x`.
        absolute: Sum up the absolute values of each pixel's derivatives by the projected mean as well, in log2 units.
        out: Where to add.
    """
    state, records = raster.state, ws.records
    transmittance, behind = load_f16(state, place), load_f16(state, place + 16)
    slope_alpha, slope_red, slope_green = (
        load_f16(state, place + 32),
        load_f16(state, place + 48),
        load_f16(state, place + 64),
    )
    slope_blue, slope_depth = load_f16(state, place + 80), load_f16(state, place + 96)
    zero = f16(0.0)
    while drawing:
        record = np.int64(peek(ws.entry_record, entry + lowest_bit(drawing)))
        drawing &= drawing - 1
        r = record * RECORD
        dx, dy = x - peek(records, r), y - peek(records, r + 1)
        t = log2_alpha(dx, dy, peek(records, r + 2), peek(records, r + 3), peek(records, r + 4), peek(records, r + 5))
        uncapped = exp2(t)
        drawn = (t >= LOG2_ALPHA_MIN) & (transmittance >= TRANSMITTANCE_MIN)
        alpha = where(drawn, minimum(uncapped, ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        red, green, blue = weight * slope_red, weight * slope_green, weight * slope_blue
        depth = weight * slope_depth
        gain = fma(peek(records, r + 6), red, fma(peek(records, r + 7), green, weight * slope_alpha))
        gain = fma(peek(records, r + 8), blue, fma(peek(records, r + 9), depth, gain))
        if raster.feature_count:
            gain = _replay_features(raster, place, record, weight, gain, out)
        behind = behind - gain
        # Derivative by the logarithm of alpha.
        v = where(uncapped < ALPHA_MAX, fma(behind, alpha / (alpha - 1.0), gain), 0.0)
        vy = v * dy
        columns = sums_over_rows(v, vy, vy * dy, weight)
        along = columns * dx
        sums = sums_over_columns(columns, along, along * dx, sums_over_rows(red, green, blue, depth))
        p = record * out.record_size
        store_f16(out.records, p, load_f16(out.records, p) + sums)
        if absolute:
            vx = v * dx
            a, b, c = peek(records, r + 2), peek(records, r + 3), peek(records, r + 4)
            gx, gy = _magnitude(fma(vx, a + a, vy * b)), _magnitude(fma(vx, b, vy * (c + c)))
            add_block_sums(out.records, p + FEATURES + raster.feature_count, gx, gy, zero, zero)
        transmittance = transmittance - weight
    store_f16(state, place, transmittance)
    store_f16(state, place + 16, behind)


@released
def blend_gradients(
    width: int,
    ws: Workspace,
    raster: Raster,
    slopes: Singles,
    replay: Singles,
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
        absolute: Sum up the absolute values of each pixel's derivatives by the projected mean as well, in log2 units.
        out: Gradient records are added to.
    """
    columns = (width + 15) >> 4
    rows = STATE_ROWS + raster.feature_count
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    for tile in range(len(ws.quad_alive)):
        if raster.tile_nodes[tile] == 0:
            continue
        left, top = (tile % columns) * 16, (tile // columns) * 16
        _load_tile(raster, slopes, replay, left, top)
        node = tile
        for k in range(raster.tile_nodes[tile]):
            entry = node * NODE
            if k + 1 < raster.tile_nodes[tile]:
                node = ws.node_next[node]
                _prefetch_node(ws, raster, node, out)
            _touch(ws, raster, entry, out)
            for block in range(16):
                drawing = peek(raster.node_blocks, (entry >> 2) + block)
                if drawing:
                    x, y = lane_x + (left + raster.block_x[block]), lane_y + (top + raster.block_y[block])
                    _replay_block(ws, raster, block * rows * 16, entry, drawing, x, y, absolute, out)
        _store_tile(raster, replay, left, top)


@inlined
def _prefetch_node(ws: Workspace, raster: Raster, node: int, out: Gradients) -> None:
    for i in range(node * NODE, node * NODE + NODE):
        record = np.int64(peek(ws.entry_record, i))
        prefetch(ws.records, record * RECORD)
        prefetch(out.records, record * out.record_size)
        if raster.feature_count:
            prefetch(raster.features, record * raster.feature_count)
