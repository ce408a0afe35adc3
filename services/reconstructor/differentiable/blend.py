"""Forward blending of the tiles' lists into planes: transmittance, colour, depth and any number of features.

Formulas as in `cpu.blend`. While a tile is blended, its state is, block by block, a row of 16 pixels per plane: that of
plane p in block k begins at (k * planes + p) * LANES.
"""

from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.blend import EXPONENT_BIT, ROUNDING, fill_tiles, log2_alpha, sort_keys
from readygo.common.rasterizer.cpu.tiles import update_quads
from readygo.common.rasterizer.cpu.workspace import (
    BLOCK,
    BLOCK_BITS,
    NODE,
    NODE_BITS,
    RECORD,
    RECORD_A,
    RECORD_B,
    RECORD_C,
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
from readygo.common.simd.memory import forget, load_f16, mark, peek, prefetch, store_f16, touching
from readygo.common.simd.types import (
    LANES,
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
from readygo.services.reconstructor.differentiable.memory import (
    FEATURE_GROUP,
    GROUP,
    NUMBER,
    PLANES,
    RED,
    TRANSMITTANCE,
    ForwardMemory,
    Raster,
)
from readygo.services.reconstructor.differentiable.released import kernel_without_gil
from readygo.services.reconstructor.differentiable.simd_rows import load_block, load_first, store_block, store_first


@inline_kernel
def _alive_blocks(width: int, height: int, left: int, top: int) -> int:
    """Bits of a tile's 4x4 blocks that hold pixels of the image."""
    blocks_x = min((width - left + BLOCK - 1) >> BLOCK_BITS, 4)
    blocks_y = min((height - top + BLOCK - 1) >> BLOCK_BITS, 4)
    # The lowest `blocks_x` bits of a row, repeated in the lowest `blocks_y` rows of four bits.
    row = (1 << blocks_x) - 1
    return row * (0x1111 & ((1 << (4 * blocks_y)) - 1))


@kernel_without_gil
def begin_planes(width: int, height: int, ws: Workspace, raster: Raster) -> None:
    """Forget the last image: black, transparent, all blocks of pixels alive."""
    columns = (width + TILE - 1) >> TILE_BITS
    ws.counts[:] = 0
    for tile in range(len(ws.quad_alive)):
        ws.tile_alive[tile] = _alive_blocks(width, height, (tile % columns) * TILE, (tile // columns) * TILE)
    size = raster.height * raster.stride
    raster.planes[:] = np.float32(0.0)
    raster.planes[TRANSMITTANCE * size : (TRANSMITTANCE + 1) * size] = np.float32(1.0)
    update_quads(ws, columns)


@kernel_without_gil
def gather_features(
    features: Float32Array, count: int, first: int, kept: ForwardMemory, ws: Workspace, raster: Raster
) -> None:
    """Copy the features of the records from `first` on, `count` numbers each, and fill rows up with zeros."""
    # Record 16 * group + lane is that of the group's Gaussian `lane`.
    stride, end = raster.feature_count, ws.counts[RECORDS] >> 4
    for group in range(first >> 4, end):
        place = group * GROUP
        for lane in range(kept.lanes[group + 1] if group + 1 < end else 0):
            prefetch(features, float_bits(kept.groups[place + GROUP + LANES * NUMBER + lane]) * count)
        for lane in range(kept.lanes[group]):
            row = float_bits(kept.groups[place + LANES * NUMBER + lane]) * count
            target = (LANES * group + lane) * stride
            for k in range(0, stride, LANES):
                store_first(raster.features, target + k, stride - k, load_first(features, row + k, count - k))


@inline_kernel
def exp2(t: Any) -> Any:
    """2^t for t in -126..1, relative error below 3e-6: a polynomial of degree 4.

    One degree more than images need: behind an alpha of 0.99, errors of transmittances are a hundred times larger.
    """
    # As in `cpu.blend`: t = n + f, 2^t = p(f) 2^n.
    shifted = t + ROUNDING
    f = t - (shifted - ROUNDING)
    p = fma(f, 0.00956967494, 0.0559182479)
    p = fma(p, f, 0.240247667)
    p = fma(p, f, 0.693121734)
    p = fma(p, f, 0.999999236)
    return float_of_bits(bit_pattern(p) + (bit_pattern(shifted) << EXPONENT_BIT))


@inline_kernel
def _write_alphas(ws: Workspace, entry: int, touched: int, x: Any, y: Any, alphas: Float32Array) -> None:
    """Write the alphas of those of a node's entries whose bit is set in a 4x4 block, one after the other.

    Two short loops, and others for what is made of them: a CPU then works on several entries at a time, although each
    of them is one long chain of operations.
    """
    records, end = ws.records, 0
    while touched:
        r = np.int64(peek(ws.entry_record, entry + lowest_bit(touched))) * RECORD
        touched &= touched - 1
        dx, dy = x - peek(records, r + RECORD_X), y - peek(records, r + RECORD_Y)
        a, b, c = peek(records, r + RECORD_A), peek(records, r + RECORD_B), peek(records, r + RECORD_C)
        store_f16(alphas, end, log2_alpha(dx, dy, a, b, c, peek(records, r + RECORD_OPACITY)))
        end += LANES
    for k in range(0, end, LANES):
        t = load_f16(alphas, k)
        store_f16(alphas, k, where(t >= LOG2_ALPHA_MIN, minimum(exp2(t), ALPHA_MAX), 0.0))


@inline_kernel
def _weigh(raster: Raster, place: int, touched: int) -> Any:
    """Take the entries whose bit is set, and whose alphas are in `raster.weights`, off the transmittances of a block.

    There the weights of those that change a pixel take the place of the alphas.

    Returns:
        Bits of the entries that change a pixel, and whether a pixel is not finished.
    """
    weights, transmittance = raster.weights, load_f16(raster.state, place)
    drawing, k, kept = 0, 0, 0
    while touched:
        # The lowest set bit.
        bit = touched & -touched
        touched ^= bit
        # Finished pixels stay as they are, even if their block continues: a difference of `TRANSMITTANCE_MIN` behind an
        # alpha of 0.99 would be a hundred times larger in the gradient.
        weight = load_f16(weights, k) * where(transmittance >= TRANSMITTANCE_MIN, transmittance, 0.0)
        transmittance = transmittance - weight
        store_f16(weights, kept, weight)
        is_drawn = holds_somewhere(weight > 0.0)
        drawing |= bit if is_drawn else 0
        kept += LANES if is_drawn else 0
        k += LANES
    store_f16(raster.state, place, transmittance)
    return drawing, holds_somewhere(transmittance >= TRANSMITTANCE_MIN)


@inline_kernel
def _add_four(
    ws: Workspace, raster: Raster, place: int, values: Float32Array, first: int, stride: int, entry: int, drawing: int
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
    a, b = load_f16(state, place), load_f16(state, place + LANES)
    c, d = load_f16(state, place + 2 * LANES), load_f16(state, place + 3 * LANES)
    kept = 0
    while drawing:
        v = np.int64(peek(ws.entry_record, entry + lowest_bit(drawing))) * stride + first
        drawing &= drawing - 1
        weight = load_f16(raster.weights, kept)
        kept += LANES
        a, b = fma(weight, peek(values, v), a), fma(weight, peek(values, v + 1), b)
        c, d = fma(weight, peek(values, v + 2), c), fma(weight, peek(values, v + 3), d)
    store_f16(state, place, a)
    store_f16(state, place + LANES, b)
    store_f16(state, place + 2 * LANES, c)
    store_f16(state, place + 3 * LANES, d)


@inline_kernel
def _copy_tile(raster: Raster, left: int, top: int, planes: int, store: bool) -> None:
    """Copy the state of a tile's blocks from the planes, or back to them."""
    size = raster.height * raster.stride
    for block in range(TILE_BLOCKS):
        pixel = (top + BLOCK * (block >> 2)) * raster.stride + left + BLOCK * (block & 3)
        for plane in range(planes):
            place, p = (block * planes + plane) * LANES, plane * size + pixel
            if store:
                store_block(raster.planes, p, raster.stride, load_f16(raster.state, place))
            else:
                store_f16(raster.state, place, load_block(raster.planes, p, raster.stride))


@kernel_without_gil
def blend(width: int, ws: Workspace, raster: Raster) -> None:
    """Sort the slab's keys, spread them to lists of the tiles, and blend these into the planes, nearest first.

    Noted is which entries changed which 4x4 blocks of pixels.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are; both are asked after
    every node.
    """
    fill_tiles(width, sort_keys(ws), ws)
    columns, planes = (width + TILE - 1) >> TILE_BITS, PLANES + raster.feature_count
    # Pixel centres of a block relative to its corner.
    lane_x, lane_y = to_float(lane_number() & (BLOCK - 1)) + 0.5, to_float(lane_number() >> BLOCK_BITS) + 0.5
    for tile in range(len(ws.quad_alive)):
        alive = ws.tile_alive[tile]
        last_place = ws.tile_place[tile]
        raster.tile_nodes[tile] = 0
        if last_place == tile * NODE or alive == 0:
            continue
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
        _copy_tile(raster, left, top, planes, False)
        node, last, drawn = tile, last_place >> NODE_BITS, 0
        size = NODE
        while alive and size == NODE:
            if node == last:
                size = last_place & (NODE - 1)
            entry = node * NODE
            # A bit per entry of the node.
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
                place = block * planes * LANES
                x, y = lane_x + (left + raster.block_x[block]), lane_y + (top + raster.block_y[block])
                _write_alphas(ws, entry, touched, x, y, raster.weights)
                drawing, unfinished = _weigh(raster, place, touched)
                mark(raster.entry_drawn, entry, drawing, 1 << block)
                # Red, green, blue, depth follow each other in the records and in the planes.
                _add_four(ws, raster, place + LANES * RED, ws.records, RECORD_RED, RECORD, entry, drawing)
                for k in range(0, raster.feature_count, FEATURE_GROUP):
                    p = place + LANES * (PLANES + k)
                    _add_four(ws, raster, p, raster.features, k, raster.feature_count, entry, drawing)
                if not unfinished:
                    alive &= ~(1 << block)
        ws.tile_alive[tile] = alive
        raster.tile_nodes[tile] = drawn
        _copy_tile(raster, left, top, planes, True)


@inline_kernel
def _prefetch_node(ws: Workspace, raster: Raster, node: int, last_place: int) -> None:
    """Ask for the records of a node of the tile whose list ends at `last_place`."""
    size = last_place & (NODE - 1) if node == last_place >> NODE_BITS else NODE
    for i in range(node * NODE, node * NODE + size):
        record = np.int64(peek(ws.entry_record, i))
        prefetch(ws.records, record * RECORD)
        if raster.feature_count:
            prefetch(raster.features, record * raster.feature_count)
