"""Forward blending of the tiles' lists into planes: transmittance, colour, depth and any number of features."""

from typing import Any

import numpy as np

from readygo.common.kernels import inlined
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.blend import ROUNDING, fill_tiles, log2_alpha, sort_keys
from readygo.common.rasterizer.cpu.tiles import update_quads
from readygo.common.rasterizer.cpu.workspace import NODE, RECORD, RECORD_RED, RECORDS, Workspace
from readygo.common.rasterizer.differentiable.memory import (
    FEATURE_GROUP,
    GROUP,
    NUMBER,
    PLANES,
    RED,
    TRANSMITTANCE,
    Kept,
    Raster,
    Singles,
)
from readygo.common.rasterizer.differentiable.released import released
from readygo.common.rasterizer.differentiable.simd_rows import load_block, load_first, store_block, store_first
from readygo.common.simd.memory import forget, load_f16, mark, peek, prefetch, store_f16, touching
from readygo.common.simd.types import (
    bit_pattern,
    float_bits,
    float_of_bits,
    fma,
    holds_somewhere,
    lane_number,
    lowest_bit,
    minimum,
    to_float,
    where,
)


@inlined
def _alive_blocks(width: int, height: int, left: int, top: int) -> int:
    """Bits of a tile's 4x4 blocks that hold pixels of the image."""
    blocks_x, blocks_y = min((width - left + 3) >> 2, 4), min((height - top + 3) >> 2, 4)
    row = (1 << blocks_x) - 1
    return row * (0x1111 & ((1 << (4 * blocks_y)) - 1))


@released
def begin_planes(width: int, height: int, ws: Workspace, raster: Raster) -> None:
    """Forget the last image: black, transparent, all blocks of pixels alive."""
    columns = (width + 15) >> 4
    ws.counts[:] = 0
    for tile in range(len(ws.quad_alive)):
        ws.tile_alive[tile] = _alive_blocks(width, height, (tile % columns) * 16, (tile // columns) * 16)
    size = raster.height * raster.stride
    raster.planes[:] = np.float32(0.0)
    raster.planes[TRANSMITTANCE * size : (TRANSMITTANCE + 1) * size] = np.float32(1.0)
    update_quads(ws, columns)


@released
def gather_features(features: Singles, count: int, first: int, kept: Kept, ws: Workspace, raster: Raster) -> None:
    """Copy the features of the records from `first` on, `count` numbers each, and fill rows up with zeros."""
    stride, end = raster.feature_count, ws.counts[RECORDS] >> 4
    for group in range(first >> 4, end):
        place = group * GROUP
        for lane in range(kept.lanes[group + 1] if group + 1 < end else 0):
            prefetch(features, float_bits(kept.groups[place + GROUP + 16 * NUMBER + lane]) * count)
        for lane in range(kept.lanes[group]):
            row = float_bits(kept.groups[place + 16 * NUMBER + lane]) * count
            target = (16 * group + lane) * stride
            for k in range(0, stride, 16):
                store_first(raster.features, target + k, stride - k, load_first(features, row + k, count - k))


@inlined
def exp2(t: Any) -> Any:
    """2^t for t in -126..1, relative error below 3e-6: a polynomial of degree 4.

    One degree more than images need: behind an alpha of 0.99, errors of transmittances are a hundred times larger.
    """
    shifted = t + ROUNDING
    f = t - (shifted - ROUNDING)
    p = fma(f, 0.00956967494, 0.0559182479)
    p = fma(p, f, 0.240247667)
    p = fma(p, f, 0.693121734)
    p = fma(p, f, 0.999999236)
    return float_of_bits(bit_pattern(p) + (bit_pattern(shifted) << 23))


@inlined
def _write_alphas(ws: Workspace, entry: int, touched: int, x: Any, y: Any, alphas: Singles) -> None:
    """Write the alphas of those of a node's entries whose bit is set in a 4x4 block, one after the other.

    Two short loops, and others for what is made of them: a CPU then works on several entries at a time, although each
    of them is one long chain of operations.
    """
    records, end = ws.records, 0
    while touched:
        r = np.int64(peek(ws.entry_record, entry + lowest_bit(touched))) * RECORD
        touched &= touched - 1
        dx, dy = x - peek(records, r), y - peek(records, r + 1)
        t = log2_alpha(dx, dy, peek(records, r + 2), peek(records, r + 3), peek(records, r + 4), peek(records, r + 5))
        store_f16(alphas, end, t)
        end += 16
    for k in range(0, end, 16):
        t = load_f16(alphas, k)
        store_f16(alphas, k, where(t >= LOG2_ALPHA_MIN, minimum(exp2(t), ALPHA_MAX), 0.0))


@inlined
def _weigh(raster: Raster, place: int, touched: int) -> Any:
    """Take the entries whose bit is set, and whose alphas are in `raster.weights`, off the transmittances of a block.

    There the weights of those that change a pixel take the place of the alphas.

    Returns:
        Bits of the entries that change a pixel, and whether a pixel is not finished.
    """
    weights, transmittance = raster.weights, load_f16(raster.state, place)
    drawing, k, kept = 0, 0, 0
    while touched:
        bit = touched & -touched
        touched ^= bit
        # Finished pixels stay as they are, even if their block continues: a difference of `TRANSMITTANCE_MIN` behind an
        # alpha of 0.99 would be a hundred times larger in the gradient.
        weight = load_f16(weights, k) * where(transmittance >= TRANSMITTANCE_MIN, transmittance, 0.0)
        transmittance = transmittance - weight
        store_f16(weights, kept, weight)
        is_drawn = holds_somewhere(weight > 0.0)
        drawing |= bit if is_drawn else 0
        kept += 16 if is_drawn else 0
        k += 16
    store_f16(raster.state, place, transmittance)
    return drawing, holds_somewhere(transmittance >= TRANSMITTANCE_MIN)


@inlined
def _add_four(
    ws: Workspace, raster: Raster, place: int, values: Singles, first: int, stride: int, entry: int, drawing: int
) -> None:
    """Add four planes of those of a node's entries whose bit is set, weighted by `raster.weights`.

    Args:
        ws: Workspace.
        raster: Weights, and the state of the tile.
        place: Where the block's four planes begin in the state.
        values: Numbers of the records, `stride` for each, those of the planes from the `first` on.
        first: Index of the four planes' first number within a record.
        stride: Numbers per record in `values`.
        entry: First entry of the node.
        drawing: Bits of the entries.
    """
    state = raster.state
    a, b = load_f16(state, place), load_f16(state, place + 16)
    c, d = load_f16(state, place + 32), load_f16(state, place + 48)
    kept = 0
    while drawing:
        v = np.int64(peek(ws.entry_record, entry + lowest_bit(drawing))) * stride + first
        drawing &= drawing - 1
        weight = load_f16(raster.weights, kept)
        kept += 16
        a, b = fma(weight, peek(values, v), a), fma(weight, peek(values, v + 1), b)
        c, d = fma(weight, peek(values, v + 2), c), fma(weight, peek(values, v + 3), d)
    store_f16(state, place, a)
    store_f16(state, place + 16, b)
    store_f16(state, place + 32, c)
    store_f16(state, place + 48, d)


@inlined
def _copy_tile(raster: Raster, left: int, top: int, planes: int, store: bool) -> None:
    """Copy the state of a tile's blocks from the planes, or back to them."""
    size = raster.height * raster.stride
    for block in range(16):
        pixel = (top + 4 * (block >> 2)) * raster.stride + left + 4 * (block & 3)
        for plane in range(planes):
            place, p = (block * planes + plane) * 16, plane * size + pixel
            if store:
                store_block(raster.planes, p, raster.stride, load_f16(raster.state, place))
            else:
                store_f16(raster.state, place, load_block(raster.planes, p, raster.stride))


@released
def blend(width: int, ws: Workspace, raster: Raster) -> None:
    """Sort the slab's keys, spread them to lists of the tiles, and blend these into the planes, nearest first.

    Noted is which entries changed which 4x4 blocks of pixels.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are; both are asked after
    every node.
    """
    fill_tiles(width, sort_keys(ws), ws)
    columns, planes = (width + 15) >> 4, PLANES + raster.feature_count
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    for tile in range(len(ws.quad_alive)):
        alive = ws.tile_alive[tile]
        last_place = ws.tile_place[tile]
        raster.tile_nodes[tile] = 0
        if last_place == tile * NODE or alive == 0:
            continue
        left, top = (tile % columns) * 16, (tile // columns) * 16
        _copy_tile(raster, left, top, planes, False)
        node, last, drawn = tile, last_place >> 6, 0
        size = NODE
        while alive and size == NODE:
            if node == last:
                size = last_place & (NODE - 1)
            entry = node * NODE
            valid = (1 << size) - 1 if size < NODE else -1
            if node != last:
                node = ws.node_next[node]
                _prefetch_node(ws, raster, node, last_place)
            elif tile + 1 < len(ws.quad_alive):
                _prefetch_node(ws, raster, tile + 1, ws.tile_place[tile + 1])
            drawn += 1
            forget(raster.entry_drawn, entry)
            waiting = alive
            while waiting:
                block = lowest_bit(waiting)
                waiting &= waiting - 1
                touched = touching(ws.entry_blocks, entry, 1 << block) & valid
                if not touched:
                    continue
                place = block * planes * 16
                x, y = lane_x + (left + raster.block_x[block]), lane_y + (top + raster.block_y[block])
                _write_alphas(ws, entry, touched, x, y, raster.weights)
                drawing, unfinished = _weigh(raster, place, touched)
                mark(raster.entry_drawn, entry, drawing, 1 << block)
                _add_four(ws, raster, place + 16 * RED, ws.records, RECORD_RED, RECORD, entry, drawing)
                for k in range(0, raster.feature_count, FEATURE_GROUP):
                    p = place + 16 * (PLANES + k)
                    _add_four(ws, raster, p, raster.features, k, raster.feature_count, entry, drawing)
                if not unfinished:
                    alive &= ~(1 << block)
        ws.tile_alive[tile] = alive
        raster.tile_nodes[tile] = drawn
        _copy_tile(raster, left, top, planes, True)


@inlined
def _prefetch_node(ws: Workspace, raster: Raster, node: int, last_place: int) -> None:
    """Ask for the records of a node of the tile whose list ends at `last_place`."""
    size = last_place & (NODE - 1) if node == last_place >> 6 else NODE
    for i in range(node * NODE, node * NODE + size):
        record = np.int64(peek(ws.entry_record, i))
        prefetch(ws.records, record * RECORD)
        if raster.feature_count:
            prefetch(raster.features, record * raster.feature_count)
