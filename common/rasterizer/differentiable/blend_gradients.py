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
from readygo.common.rasterizer.differentiable.partial_sums import add, add_product, no_sum, totals
from readygo.common.rasterizer.differentiable.released import released
from readygo.common.rasterizer.differentiable.simd_rows import (
    add_block_sums,
    load_block,
    store_block,
)
from readygo.common.simd.memory import load_f16, peek, poke, prefetch, store_f16, touching
from readygo.common.simd.types import f16, fma, lane_number, lowest_bit, maximum, minimum, to_float, where

STATE_ROWS = PLANES + 4
"""Per block: transmittance, what is left behind, pixel centres x and y, then the derivatives of the planes, that of
transmittance negative."""


@inlined
def _load_tile(raster: Raster, slopes: Singles, replay: Singles, left: int, top: int) -> None:
    """Set up the state of a tile's blocks."""
    size = raster.height * raster.stride
    planes = PLANES + raster.feature_count
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    for block in range(16):
        pixel = (top + 4 * (block >> 2)) * raster.stride + left + 4 * (block & 3)
        place = block * (planes + 4) * 16
        store_f16(raster.state, place, load_block(replay, pixel, raster.stride))
        store_f16(raster.state, place + 16, load_block(replay, size + pixel, raster.stride))
        store_f16(raster.state, place + 32, lane_x + (left + raster.block_x[block]))
        store_f16(raster.state, place + 48, lane_y + (top + raster.block_y[block]))
        # The sum of weights is one minus the transmittance.
        store_f16(raster.state, place + 64, 0.0 - load_block(slopes, TRANSMITTANCE * size + pixel, raster.stride))
        for plane in range(1, planes):
            store_f16(raster.state, place + 64 + 16 * plane, load_block(slopes, plane * size + pixel, raster.stride))


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
def _touch(record: int, out: Gradients) -> None:
    """Set the gradient records of a record's group to 0 if it is the first of them that is replayed."""
    group = record >> 4
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
def _replay_entry(ws: Workspace, raster: Raster, record: int, drawn: int, absolute: bool, out: Gradients) -> None:
    """Draw a record into the 4x4 blocks whose bit is set in `drawn` once more, and add its derivatives.

    Args:
        ws: Workspace.
        raster: State of the tile.
        record: Number of the record.
        drawn: Blocks of the tile.
        absolute: Sum up the absolute values of each pixel's derivatives by the projected mean as well, in log2 units.
        out: Where to add.
    """
    state, records = raster.state, ws.records
    r, p = record * RECORD, record * out.record_size
    m0, m1, m2, m3, m4, m5 = no_sum(), no_sum(), no_sum(), no_sum(), no_sum(), no_sum()
    weights, reds, greens, blues, depths = no_sum(), no_sum(), no_sum(), no_sum(), no_sum()
    while drawn:
        place = lowest_bit(drawn) * (16 * (STATE_ROWS + raster.feature_count))
        drawn &= drawn - 1
        transmittance = load_f16(state, place)
        dx, dy = load_f16(state, place + 32) - peek(records, r), load_f16(state, place + 48) - peek(records, r + 1)
        t = log2_alpha(dx, dy, peek(records, r + 2), peek(records, r + 3), peek(records, r + 4), peek(records, r + 5))
        uncapped = exp2(t)
        drawing = (t >= LOG2_ALPHA_MIN) & (transmittance >= TRANSMITTANCE_MIN)
        alpha = where(drawing, minimum(uncapped, ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        store_f16(state, place, transmittance - weight)
        red, green, blue = load_f16(state, place + 80), load_f16(state, place + 96), load_f16(state, place + 112)
        depth = load_f16(state, place + 128)
        gain = fma(peek(records, r + 6), red, fma(peek(records, r + 7), green, load_f16(state, place + 64)))
        gain = weight * fma(peek(records, r + 8), blue, fma(peek(records, r + 9), depth, gain))
        if raster.feature_count:
            gain = _replay_features(raster, place, record, weight, gain, out)
        behind = load_f16(state, place + 16) - gain
        store_f16(state, place + 16, behind)
        # Derivative by the logarithm of alpha.
        v = where(uncapped < ALPHA_MAX, fma(behind, alpha / (alpha - 1.0), gain), 0.0)
        vx, vy = v * dx, v * dy
        m0, m1, m2 = add(m0, v), add(m1, vx), add(m2, vy)
        m3, m4, m5 = add_product(m3, vx, dx), add_product(m4, vx, dy), add_product(m5, vy, dy)
        weights, depths = add(weights, weight), add_product(depths, weight, depth)
        reds, greens = add_product(reds, weight, red), add_product(greens, weight, green)
        blues = add_product(blues, weight, blue)
        if absolute:
            a, b, c = peek(records, r + 2), peek(records, r + 3), peek(records, r + 4)
            gx, gy = _magnitude(fma(vx, a + a, vy * b)), _magnitude(fma(vx, b, vy * (c + c)))
            zero = f16(0.0)
            add_block_sums(out.records, p + FEATURES + raster.feature_count, gx, gy, zero, zero)
    sums = totals(m0, m1, m2, m3, m4, m5, weights, reds, greens, blues, depths)
    store_f16(out.records, p, load_f16(out.records, p) + sums)


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
        replay: State of the pixels as `begin_replay` makes it, which this call continues.
        absolute: Sum up the absolute values of each pixel's derivatives by the projected mean as well, in log2 units.
        out: Gradient records are added to.
    """
    columns = (width + 15) >> 4
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
            elif tile + 1 < len(ws.quad_alive) and raster.tile_nodes[tile + 1]:
                _prefetch_node(ws, raster, tile + 1, out)
            waiting = touching(raster.entry_drawn, entry, 0xFFFF)
            while waiting:
                place = entry + lowest_bit(waiting)
                waiting &= waiting - 1
                record = np.int64(peek(ws.entry_record, place))
                if waiting:
                    # Asked for with the whole node, but the tile's state may have taken their place in the cache.
                    _prefetch_record(ws, np.int64(peek(ws.entry_record, entry + lowest_bit(waiting))), out)
                _touch(record, out)
                _replay_entry(ws, raster, record, np.int64(peek(raster.entry_drawn, place)), absolute, out)
        _store_tile(raster, replay, left, top)


@inlined
def _prefetch_record(ws: Workspace, record: int, out: Gradients) -> None:
    prefetch(ws.records, record * RECORD)
    prefetch(out.records, record * out.record_size)


@inlined
def _prefetch_node(ws: Workspace, raster: Raster, node: int, out: Gradients) -> None:
    waiting = touching(raster.entry_drawn, node * NODE, 0xFFFF)
    while waiting:
        record = np.int64(peek(ws.entry_record, node * NODE + lowest_bit(waiting)))
        waiting &= waiting - 1
        _prefetch_record(ws, record, out)
        if raster.feature_count:
            prefetch(raster.features, record * raster.feature_count)
