"""From projected Gaussians to pixels: depth sort, lists per tile, blending; `workspace` has the legend.

Front to back, with transmittance T = 1 at first, a pixel at an offset (dx, dy) from a record's mean gets

    alpha = min(0.99, opacity exp(-q / 2)),   q = (dx, dy) (image covariance)^-1 (dx, dy)^T,   0 below 1/255
    weight = alpha T,   colour += weight * record's colour,   T -= weight,   finished once T < 1e-4.

Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 6 and appendix C.
"""

from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.constants import ALPHA_MAX, LOG2_ALPHA_MIN, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu.tiles import LARGE, is_alive, tile_blocks, unpack_box, update_quads
from readygo.common.rasterizer.cpu.workspace import (
    BLOCK,
    BLOCK_BITS,
    BLOCK_STATE,
    BOX,
    DEPTH_SHIFT,
    DIGIT_BITS,
    DIGITS,
    KEYS,
    LATER,
    NODE,
    NODE_BITS,
    RECORD,
    RECORD_A,
    RECORD_B,
    RECORD_BLUE,
    RECORD_C,
    RECORD_DEPTH,
    RECORD_GREEN,
    RECORD_MASK,
    RECORD_NORMAL,
    RECORD_OPACITY,
    RECORD_RED,
    RECORD_X,
    RECORD_Y,
    STATE_BLUE,
    STATE_GREEN,
    STATE_RED,
    STATE_TRANSMITTANCE,
    TILE,
    TILE_BITS,
    TILE_BLOCKS,
    TILE_STATE,
    Depths,
    Workspace,
)
from readygo.common.simd.memory import load_f16, load_i16, peek, poke, prefetch, store_f16, store_i16, touching
from readygo.common.simd.types import (
    LANES,
    bit_pattern,
    f16,
    float_of_bits,
    fma,
    integer_where,
    lane_number,
    lowest_bit,
    mask_bits,
    minimum,
    to_float,
    where,
)

ROUNDING = 12582912.0
"""1.5 * 2^23: added to a smaller float32, it leaves the nearest integer in the lowest bits."""
EXPONENT_BIT = 23
"""Where the exponent of a float32 begins."""


@kernel
def begin_image(width: int, height: int, ws: Workspace) -> None:
    """Forget the last image: black, transparent, all blocks of pixels alive."""
    columns = (width + TILE - 1) >> TILE_BITS
    ws.counts[:] = 0
    for tile in range(len(ws.quad_alive)):
        # Of a tile's 4x4 blocks, those that hold pixels of the image.
        blocks_x = min(((width + BLOCK - 1) >> BLOCK_BITS) - 4 * (tile % columns), 4)
        blocks_y = min(((height + BLOCK - 1) >> BLOCK_BITS) - 4 * (tile // columns), 4)
        ws.tile_alive[tile] = tile_blocks(0, blocks_x - 1, 0, blocks_y - 1, 0, 0)
        for block in range(TILE_BLOCKS):
            place = tile * TILE_STATE + block * BLOCK_STATE
            for channel in range(3):
                store_f16(ws.tile_state, place + STATE_RED + LANES * channel, f16(0.0))
            store_f16(ws.tile_state, place + STATE_TRANSMITTANCE, f16(1.0))
    update_quads(ws, columns)


@kernel
def begin_slab(width: int, limit_bits: int, ws: Workspace) -> None:
    """Start a slab with those of the Gaussians projected earlier that lie before its limit."""
    columns = (width + TILE - 1) >> TILE_BITS
    update_quads(ws, columns)
    waiting = ws.counts[LATER]
    kept, drawn = 0, 0
    for i in range(waiting):
        key = peek(ws.later, i)
        if (key >> DEPTH_SHIFT) >= limit_bits:
            poke(ws.later, kept, key)
            kept += 1
            continue
        record = key & RECORD_MASK
        # Written in any case, counted if its pixels are not all finished.
        poke(ws.keys, drawn, key)
        drawn += is_alive(ws, columns, peek(ws.boxes, BOX * record), peek(ws.boxes, BOX * record + 1))
    ws.counts[KEYS], ws.counts[LATER] = drawn, kept


@kernel
def sort_keys(ws: Workspace) -> bool:
    """Sort the slab's keys by depth, equal depths in order of projection; True if the result is in `sorted_keys`.

    A radix sort of the depths' bits above the slab's nearest, lowest digit first: one pass per 12 bits, of which each
    keeps the order of the ones before. All passes count their digits in one reading of the keys.
    """
    n = ws.counts[KEYS]
    if n == 0:
        return False
    low, high = peek(ws.keys, 0) >> DEPTH_SHIFT, peek(ws.keys, 0) >> DEPTH_SHIFT
    for i in range(n):
        depth = peek(ws.keys, i) >> DEPTH_SHIFT
        low, high = min(low, depth), max(high, depth)
    # As few passes as the range of depths needs, with digits of equal length.
    bits = 0
    while (high - low) >> bits:
        bits += 1
    passes = (bits + DIGIT_BITS - 1) // DIGIT_BITS
    digit = (bits + passes - 1) // max(passes, 1)
    base, last = low << DEPTH_SHIFT, (1 << digit) - 1
    # `places` of pass k, from k * DIGITS on: how often each digit occurs, then where the next key with it goes.
    places = ws.digit_places
    places[: passes * DIGITS] = 0
    for i in range(n):
        depth = (peek(ws.keys, i) - base) >> DEPTH_SHIFT
        for k in range(passes):
            value = k * DIGITS + ((depth >> (k * digit)) & last)
            poke(places, value, peek(places, value) + 1)
    source, target = ws.keys, ws.sorted_keys
    for k in range(passes):
        first = np.int64(0)
        for value in range(k * DIGITS, k * DIGITS + last + 1):
            size = np.int64(peek(places, value))
            poke(places, value, first)
            first += size
        shift = DEPTH_SHIFT + k * digit
        for i in range(n):
            key = peek(source, i)
            value = k * DIGITS + (((key - base) >> shift) & last)
            place = np.int64(peek(places, value))
            poke(target, place, key)
            poke(places, value, place + 1)
        source, target = target, source
    return passes % 2 == 1


@kernel
def fill_tiles(width: int, in_sorted: bool, ws: Workspace) -> None:
    """Spread the sorted keys to lists per tile: chains of nodes of 64 entries.

    `tile_place` of a tile is where its next entry goes: entry place & (NODE - 1) of the node place >> NODE_BITS. The
    first nodes are those of the tiles; three more take the entries of boxes that do not reach a second tile.
    """
    columns, tiles = (width + 15) >> 4, len(ws.quad_alive)
    keys = ws.sorted_keys if in_sorted else ws.keys
    n = ws.counts[KEYS]
    for tile in range(tiles + 3):
        ws.tile_place[tile] = tile * NODE
    nodes = tiles + 3
    for i in range(n):
        prefetch(ws.boxes, BOX * (peek(keys, min(i + 16, n - 1)) & RECORD_MASK))
        record = peek(keys, i) & RECORD_MASK
        tile, blocks = peek(ws.boxes, BOX * record), peek(ws.boxes, BOX * record + 1)
        if tile == LARGE:
            nodes = _fill_large(ws, nodes, columns, record, blocks)
            continue
        # 16 bits each: blocks of the first tile, of the one right of it, below it, and right below it.
        right, below, beyond = (blocks >> 16) & 0xFFFF, (blocks >> 32) & 0xFFFF, (blocks >> 48) & 0xFFFF
        # Four writes in any case: cheaper than branches that the CPU cannot foresee.
        nodes = _write_entry(ws, nodes, tile, record, blocks & 0xFFFF, 1)
        nodes = _write_entry(ws, nodes, tile + 1 if right else tiles, record, right, 1 if right else 0)
        nodes = _write_entry(ws, nodes, tile + columns if below else tiles + 1, record, below, 1 if below else 0)
        nodes = _write_entry(ws, nodes, tile + columns + 1 if beyond else tiles + 2, record, beyond, 1 if beyond else 0)


@inline_kernel
def _write_entry(ws: Workspace, nodes: int, tile: int, record: int, blocks: int, exists: int) -> int:
    """Append an entry to a tile's list if it `exists` (0 or 1); the number of nodes in use after that."""
    p = peek(ws.tile_place, tile)
    poke(ws.entry_record, p, record)
    poke(ws.entry_blocks, p, blocks)
    following = p + exists
    # The node is full: an entry was added, and the next place is the first of the node behind.
    if (following & (NODE - 1)) < exists:
        poke(ws.node_next, p >> NODE_BITS, nodes)
        following = nodes << NODE_BITS
        nodes += 1
    poke(ws.tile_place, tile, following)
    return nodes


@inline_kernel
def _fill_large(ws: Workspace, nodes: int, columns: int, record: int, box: int) -> int:
    """Append an entry to every tile that a large box meets; the number of nodes in use after that."""
    x0, x1, y0, y1 = unpack_box(box)
    for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
        for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
            blocks = tile_blocks(x0, x1, y0, y1, tile_x, tile_y)
            nodes = _write_entry(ws, nodes, tile_y * columns + tile_x, record, blocks, 1)
    return nodes


@inline_kernel
def log2_alpha(dx: Any, dy: Any, a: Any, b: Any, c: Any, log2_opacity: Any) -> Any:
    """Binary logarithm of alpha at an offset (dx, dy) from a mean [px]: a dx^2 + b dx dy + c dy^2 + log2_opacity."""
    return fma(dx, fma(dx, a, dy * b), fma(dy * c, dy, log2_opacity))


@inline_kernel
def _exp2(t: Any) -> Any:
    """2^t for t in -126..1, relative error below 8e-5: a polynomial of degree 3, best in the relative sense."""
    # t = n + f with the nearest integer n, which stands in the lowest bits of `shifted`; 2^t = p(f) 2^n, |f| <= 1/2.
    shifted = t + ROUNDING
    f = t - (shifted - ROUNDING)
    p = fma(f, 0.0551716703, 0.242611125)
    p = fma(p, f, 0.693260985)
    p = fma(p, f, 0.999928073)
    # Times 2^n: n is added to the exponent's bits.
    return float_of_bits(bit_pattern(p) + (bit_pattern(shifted) << EXPONENT_BIT))


@inline_kernel
def _blend_block(
    ws: Workspace,
    depths: Depths | None,
    normals: Float32Array | None,
    place: int,
    entry: int,
    touched: int,
    x: Any,
    y: Any,
) -> bool:
    """Blend those of a node's entries whose bit is set into a 4x4 block of pixels.

    Args:
        ws: Workspace.
        depths: Where depths are summed up; None: the compiled code has no trace of them.
        normals: Where normals are summed up; None: the compiled code has no trace of them.
        place: Where the block's state begins.
        entry: First entry of the node.
        touched: A bit per entry.
        x: Columns of the pixel centres [px].
        y: Rows of the pixel centres [px].

    Returns:
        True if a pixel is not finished.
    """
    state = ws.tile_state
    red, green = load_f16(state, place + STATE_RED), load_f16(state, place + STATE_GREEN)
    blue, transmittance = load_f16(state, place + STATE_BLUE), load_f16(state, place + STATE_TRANSMITTANCE)
    records = ws.records
    # A block's state has four numbers per pixel: depths and normals, one and three, lie at place / 4 and 3 place / 4.
    if depths is not None:
        depth, median = load_f16(depths.weighted_m, place >> 2), load_i16(depths.median, place >> 2)
    if normals is not None:
        n = 3 * (place >> 2)
        normal_x, normal_y = load_f16(normals, n), load_f16(normals, n + LANES)
        normal_z = load_f16(normals, n + 2 * LANES)
    while touched:
        record = np.int64(peek(ws.entry_record, entry + lowest_bit(touched)))
        r = record * RECORD
        touched &= touched - 1
        dx, dy = x - peek(records, r + RECORD_X), y - peek(records, r + RECORD_Y)
        a, b, c = peek(records, r + RECORD_A), peek(records, r + RECORD_B), peek(records, r + RECORD_C)
        t = log2_alpha(dx, dy, a, b, c, peek(records, r + RECORD_OPACITY))
        alpha = where(t >= LOG2_ALPHA_MIN, minimum(_exp2(t), ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        red, green, blue = (
            fma(weight, peek(records, r + RECORD_RED), red),
            fma(weight, peek(records, r + RECORD_GREEN), green),
            fma(weight, peek(records, r + RECORD_BLUE), blue),
        )
        if depths is not None:
            # Not for finished pixels: a sky at 1.8 km would move even a weight of TRANSMITTANCE_MIN by 0.2 m.
            unfinished = transmittance >= TRANSMITTANCE_MIN
            depth = where(unfinished, fma(weight, peek(records, r + RECORD_DEPTH), depth), depth)
            # Every Gaussian of the list while half of the light is left; the last of them takes it below.
            median = integer_where(transmittance >= 0.5, record, median)
        if normals is not None:
            normal_x, normal_y, normal_z = (
                fma(weight, peek(records, r + RECORD_NORMAL), normal_x),
                fma(weight, peek(records, r + RECORD_NORMAL + 1), normal_y),
                fma(weight, peek(records, r + RECORD_NORMAL + 2), normal_z),
            )
        transmittance = transmittance - weight
    store_f16(state, place + STATE_RED, red)
    store_f16(state, place + STATE_GREEN, green)
    store_f16(state, place + STATE_BLUE, blue)
    store_f16(state, place + STATE_TRANSMITTANCE, transmittance)
    if depths is not None:
        store_f16(depths.weighted_m, place >> 2, depth)
        store_i16(depths.median, place >> 2, median)
    if normals is not None:
        store_f16(normals, n, normal_x)
        store_f16(normals, n + LANES, normal_y)
        store_f16(normals, n + 2 * LANES, normal_z)
    return bool(mask_bits(transmittance >= TRANSMITTANCE_MIN) != 0)


@kernel
def blend_tiles(width: int, ws: Workspace, depths: Depths | None, normals: Float32Array | None) -> int:
    """Blend the slab's lists into the tiles, nearest first; the number of entries that were looked at.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are.

    Args:
        width: Image width [px].
        ws: Workspace.
        depths: Where depths are summed up, if they are wanted.
        normals: Where normals are summed up, if they are wanted.
    """
    columns = (width + TILE - 1) >> TILE_BITS
    # Pixel centres of a block relative to its corner.
    lane_x, lane_y = to_float(lane_number() & (BLOCK - 1)) + 0.5, to_float(lane_number() >> BLOCK_BITS) + 0.5
    looked_at = 0
    for tile in range(len(ws.quad_alive)):
        alive = ws.tile_alive[tile]
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
        node, last = tile, ws.tile_place[tile] >> NODE_BITS
        size = NODE
        while alive and size == NODE:
            if node == last:
                size = ws.tile_place[tile] & (NODE - 1)
            entry = node * NODE
            # A bit per entry of the node.
            valid = (1 << size) - 1 if size < NODE else -1
            if node != last:
                node = ws.node_next[node]
                _prefetch_records(ws, node, NODE if node != last else ws.tile_place[tile] & (NODE - 1))
            waiting = alive
            while waiting:
                block = lowest_bit(waiting)
                waiting &= waiting - 1
                touched = touching(ws.entry_blocks, entry, 1 << block) & valid
                if not touched:
                    continue
                x = lane_x + np.float32(left + BLOCK * (block & 3))
                y = lane_y + np.float32(top + BLOCK * (block >> 2))
                place = tile * TILE_STATE + block * BLOCK_STATE
                if not _blend_block(ws, depths, normals, place, entry, touched, x, y):
                    alive &= ~(1 << block)
            looked_at += size
        ws.tile_alive[tile] = alive
    return looked_at


@inline_kernel
def _prefetch_records(ws: Workspace, node: int, size: int) -> None:
    """Ask the cache for the records of a node with `size` entries."""
    for i in range(node * NODE, node * NODE + size):
        prefetch(ws.records, np.int64(peek(ws.entry_record, i)) * RECORD)


@kernel
def draw_slab(
    width: int, next_limit_bits: int, ws: Workspace, depths: Depths | None, normals: Float32Array | None
) -> None:
    """Draw what was projected for a slab, and begin the next one; one call, because each one from Python takes 4 us."""
    in_sorted = sort_keys(ws)
    fill_tiles(width, in_sorted, ws)
    blend_tiles(width, ws, depths, normals)
    begin_slab(width, next_limit_bits, ws)


@kernel
def write_floats(width: int, ws: Workspace, rgb: Float32Array) -> None:
    """Copy the tiles' colours to an image, shape (H, W, 3)."""
    columns = (width + TILE - 1) >> TILE_BITS
    for v in range(rgb.shape[0]):
        for u in range(width):
            # The tile, the block in the tile, the pixel in the block.
            tile = (v >> TILE_BITS) * columns + (u >> TILE_BITS)
            block = ((v >> BLOCK_BITS) & 3) * 4 + ((u >> BLOCK_BITS) & 3)
            place = tile * TILE_STATE + block * BLOCK_STATE + (v & (BLOCK - 1)) * BLOCK + (u & (BLOCK - 1))
            for channel in range(3):
                rgb[v, u, channel] = ws.tile_state[place + LANES * channel]


@kernel
def write_bytes(width: int, ws: Workspace, rgb: UInt8Array) -> None:
    """Copy the tiles' colours to an image of bytes, rounded and clipped, shape (H, W, 3)."""
    columns = (width + TILE - 1) >> TILE_BITS
    for v in range(rgb.shape[0]):
        for u in range(width):
            # The tile, the block in the tile, the pixel in the block.
            tile = (v >> TILE_BITS) * columns + (u >> TILE_BITS)
            block = ((v >> BLOCK_BITS) & 3) * 4 + ((u >> BLOCK_BITS) & 3)
            place = tile * TILE_STATE + block * BLOCK_STATE + (v & (BLOCK - 1)) * BLOCK + (u & (BLOCK - 1))
            for channel in range(3):
                value = ws.tile_state[place + LANES * channel] * np.float32(255.0) + np.float32(0.5)
                rgb[v, u, channel] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
