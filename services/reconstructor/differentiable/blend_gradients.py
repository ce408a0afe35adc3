"""Backward blending: the tiles' lists are replayed front to back.

Legend, for one pixel: records i = 1, 2, .. from the front with alpha_i, transmittance T_i before them, weights
w_i = alpha_i T_i; c_i what record i has for the planes (red, green, blue, depth, features), P = sum of w_i c_i the
planes, s the slopes dL / dP. As the sum of weights is 1 - T, the transmittance counts as a plane with c = 1 and the
slope -dL / dT.

    gain_i    w_i (s . c_i), what record i gives to the loss, linearised
    behind_i  sum of gain_j over j > i; T_j of these has the factor 1 - alpha_i

    dL / d ln(alpha_i) = gain_i - behind_i alpha_i / (1 - alpha_i),   0 where alpha is capped,   dL / dc_i = w_i s.

`behind` starts as s . P of the finished image, and loses every gain on the way, so that nothing is divided by small
transmittances. The moments of v = dL / d ln(alpha) become derivatives in `project_gradients`.
"""

from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.blend import log2_alpha
from readygo.common.rasterizer.cpu.workspace import (
    BLOCK,
    BLOCK_BITS,
    NODE,
    RECORD,
    RECORD_A,
    RECORD_B,
    RECORD_BLUE,
    RECORD_C,
    RECORD_DEPTH,
    RECORD_GREEN,
    RECORD_OPACITY,
    RECORD_RED,
    RECORD_X,
    RECORD_Y,
    RECORDS,
    TILE,
    TILE_BITS,
    TILE_BLOCKS,
    Workspace,
)
from readygo.common.simd.memory import load_f16, peek, poke, prefetch, store_f16, touching
from readygo.common.simd.types import LANES, f16, fma, lane_number, lowest_bit, maximum, minimum, to_float, where
from readygo.services.reconstructor.differentiable.blend import exp2
from readygo.services.reconstructor.differentiable.memory import (
    DEPTH,
    FEATURE_GROUP,
    FEATURES,
    PLANES,
    RED,
    TRANSMITTANCE,
    Gradients,
    Raster,
)
from readygo.services.reconstructor.differentiable.partial_sums import add, add_product, no_sum, totals
from readygo.services.reconstructor.differentiable.released import kernel_without_gil
from readygo.services.reconstructor.differentiable.simd_rows import (
    add_block_sums,
    load_block,
    store_block,
)

LIGHT, BEHIND, CENTRE_X, CENTRE_Y, SLOPES = 0, LANES, 2 * LANES, 3 * LANES, 4 * LANES
"""Rows of a block's state: transmittance, what is left behind, pixel centres x and y, then the slopes of the planes,
that of transmittance negative."""
SLOPE_RED, SLOPE_GREEN, SLOPE_BLUE = SLOPES + LANES * RED, SLOPES + LANES * (RED + 1), SLOPES + LANES * (RED + 2)
SLOPE_DEPTH = SLOPES + LANES * DEPTH
STATE_ROWS = PLANES + 4
"""Rows of a block without features."""


@inline_kernel
def _load_tile(raster: Raster, slopes: Float32Array, replay: Float32Array, left: int, top: int) -> None:
    """Set up the state of a tile's blocks."""
    size = raster.height * raster.stride
    planes = PLANES + raster.feature_count
    lane_x, lane_y = to_float(lane_number() & (BLOCK - 1)) + 0.5, to_float(lane_number() >> BLOCK_BITS) + 0.5
    for block in range(TILE_BLOCKS):
        pixel = (top + BLOCK * (block >> 2)) * raster.stride + left + BLOCK * (block & 3)
        place = block * (planes + 4) * LANES
        store_f16(raster.state, place + LIGHT, load_block(replay, pixel, raster.stride))
        store_f16(raster.state, place + BEHIND, load_block(replay, size + pixel, raster.stride))
        store_f16(raster.state, place + CENTRE_X, lane_x + (left + raster.block_x[block]))
        store_f16(raster.state, place + CENTRE_Y, lane_y + (top + raster.block_y[block]))
        # The sum of weights is one minus the transmittance.
        store_f16(raster.state, place + SLOPES, 0.0 - load_block(slopes, TRANSMITTANCE * size + pixel, raster.stride))
        for plane in range(1, planes):
            slope = load_block(slopes, plane * size + pixel, raster.stride)
            store_f16(raster.state, place + SLOPES + LANES * plane, slope)


@inline_kernel
def _store_tile(raster: Raster, replay: Float32Array, left: int, top: int) -> None:
    """Keep transmittance and what is left behind for the next slab."""
    size = raster.height * raster.stride
    for block in range(TILE_BLOCKS):
        pixel = (top + BLOCK * (block >> 2)) * raster.stride + left + BLOCK * (block & 3)
        place = block * (STATE_ROWS + raster.feature_count) * LANES
        store_block(replay, pixel, raster.stride, load_f16(raster.state, place + LIGHT))
        store_block(replay, size + pixel, raster.stride, load_f16(raster.state, place + BEHIND))


@kernel_without_gil
def begin_replay(ws: Workspace, raster: Raster, slopes: Float32Array, replay: Float32Array, out: Gradients) -> None:
    """Start with full transmittance, the whole image left behind, and no record replayed.

    Args:
        ws: Workspace after the last slab.
        raster: Finished planes.
        slopes: Derivatives of the loss by the planes, laid out as these.
        replay: Two planes: transmittance, and the sum of slopes times what the entries to come add to the planes.
        out: No group of it is touched.
    """
    size = raster.height * raster.stride
    for p in range(0, size, LANES):
        store_f16(replay, p, f16(1.0))
        # behind = -dL/dT (1 - T) + sum of slope * plane over the others.
        behind = load_f16(slopes, p) * (load_f16(raster.planes, p) - 1.0)
        for plane in range(1, PLANES + raster.feature_count):
            behind = fma(load_f16(slopes, plane * size + p), load_f16(raster.planes, plane * size + p), behind)
        store_f16(replay, size + p, behind)
    for group in range(ws.counts[RECORDS] >> 4):
        out.touched[group] = 0


@inline_kernel
def _touch(record: int, out: Gradients) -> None:
    """Set the gradient records of a record's group to 0 if it is the first of them that is replayed."""
    group = record >> 4
    if peek(out.touched, group) == 0:
        poke(out.touched, group, 1)
        first = group * LANES * out.record_size
        for k in range(first, first + LANES * out.record_size, LANES):
            store_f16(out.records, k, f16(0.0))


@inline_kernel
def _replay_features(raster: Raster, place: int, record: int, weight: Any, gain: Any, out: Gradients) -> Any:
    """Add a record's features to what it gives the loss, and their derivatives to its gradient record."""
    state, features = raster.state, raster.features
    for group in range(0, raster.feature_count, FEATURE_GROUP):
        # a, b, c, d: weight times slope, the derivatives by four features.
        p, f = place + LANES * (STATE_ROWS + group), record * raster.feature_count + group
        a, b = weight * load_f16(state, p), weight * load_f16(state, p + LANES)
        c, d = weight * load_f16(state, p + 2 * LANES), weight * load_f16(state, p + 3 * LANES)
        gain = fma(peek(features, f), a, fma(peek(features, f + 1), b, gain))
        gain = fma(peek(features, f + 2), c, fma(peek(features, f + 3), d, gain))
        add_block_sums(out.records, record * out.record_size + FEATURES + group, a, b, c, d)
    return gain


@inline_kernel
def _magnitude(x: Any) -> Any:
    """The absolute value."""
    return maximum(x, 0.0 - x)


@inline_kernel
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
    # Sums over pixels of v, v dx, v dy, v dx^2, v dx dy, v dy^2; of weights, and of weights times slopes.
    m0, m1, m2, m3, m4, m5 = no_sum(), no_sum(), no_sum(), no_sum(), no_sum(), no_sum()
    weights, reds, greens, blues, depths = no_sum(), no_sum(), no_sum(), no_sum(), no_sum()
    while drawn:
        place = lowest_bit(drawn) * (LANES * (STATE_ROWS + raster.feature_count))
        drawn &= drawn - 1
        transmittance = load_f16(state, place + LIGHT)
        dx = load_f16(state, place + CENTRE_X) - peek(records, r + RECORD_X)
        dy = load_f16(state, place + CENTRE_Y) - peek(records, r + RECORD_Y)
        t = log2_alpha(
            dx,
            dy,
            peek(records, r + RECORD_A),
            peek(records, r + RECORD_B),
            peek(records, r + RECORD_C),
            peek(records, r + RECORD_OPACITY),
        )
        uncapped = exp2(t)
        drawing = (t >= LOG2_ALPHA_MIN) & (transmittance >= TRANSMITTANCE_MIN)
        alpha = where(drawing, minimum(uncapped, ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        store_f16(state, place + LIGHT, transmittance - weight)
        # Slopes of the planes, and gain = weight * (their sum, each times the record's number).
        red, green = load_f16(state, place + SLOPE_RED), load_f16(state, place + SLOPE_GREEN)
        blue, depth = load_f16(state, place + SLOPE_BLUE), load_f16(state, place + SLOPE_DEPTH)
        gain = fma(
            peek(records, r + RECORD_RED),
            red,
            fma(peek(records, r + RECORD_GREEN), green, load_f16(state, place + SLOPES)),
        )
        gain = weight * fma(peek(records, r + RECORD_BLUE), blue, fma(peek(records, r + RECORD_DEPTH), depth, gain))
        if raster.feature_count:
            gain = _replay_features(raster, place, record, weight, gain, out)
        behind = load_f16(state, place + BEHIND) - gain
        store_f16(state, place + BEHIND, behind)
        # Derivative by the logarithm of alpha: gain - behind alpha / (1 - alpha).
        v = where(uncapped < ALPHA_MAX, fma(behind, alpha / (alpha - 1.0), gain), 0.0)
        vx, vy = v * dx, v * dy
        m0, m1, m2 = add(m0, v), add(m1, vx), add(m2, vy)
        m3, m4, m5 = add_product(m3, vx, dx), add_product(m4, vx, dy), add_product(m5, vy, dy)
        weights, depths = add(weights, weight), add_product(depths, weight, depth)
        reds, greens = add_product(reds, weight, red), add_product(greens, weight, green)
        blues = add_product(blues, weight, blue)
        if absolute:
            # d log2(alpha) / d(dx, dy) = (2 A dx + B dy, B dx + 2 C dy).
            a, b, c = peek(records, r + RECORD_A), peek(records, r + RECORD_B), peek(records, r + RECORD_C)
            gx, gy = _magnitude(fma(vx, a + a, vy * b)), _magnitude(fma(vx, b, vy * (c + c)))
            zero = f16(0.0)
            add_block_sums(out.records, p + FEATURES + raster.feature_count, gx, gy, zero, zero)
    sums = totals(m0, m1, m2, m3, m4, m5, weights, reds, greens, blues, depths)
    store_f16(out.records, p, load_f16(out.records, p) + sums)


@kernel_without_gil
def blend_gradients(
    width: int,
    ws: Workspace,
    raster: Raster,
    slopes: Float32Array,
    replay: Float32Array,
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
    columns = (width + TILE - 1) >> TILE_BITS
    for tile in range(len(ws.quad_alive)):
        if raster.tile_nodes[tile] == 0:
            continue
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
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


@inline_kernel
def _prefetch_record(ws: Workspace, record: int, out: Gradients) -> None:
    prefetch(ws.records, record * RECORD)
    prefetch(out.records, record * out.record_size)


@inline_kernel
def _prefetch_node(ws: Workspace, raster: Raster, node: int, out: Gradients) -> None:
    waiting = touching(raster.entry_drawn, node * NODE, 0xFFFF)
    while waiting:
        record = np.int64(peek(ws.entry_record, node * NODE + lowest_bit(waiting)))
        waiting &= waiting - 1
        _prefetch_record(ws, record, out)
        if raster.feature_count:
            prefetch(raster.features, record * raster.feature_count)
