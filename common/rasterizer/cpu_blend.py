"""From projected Gaussians to pixels: depth sort, lists per tile, blending."""

from typing import Any

import numpy as np
import numpy.typing as npt

from common.rasterizer.compilation import inlined, kernel
from common.rasterizer.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from common.rasterizer.cpu_tiles import LARGE, bounds, count_entries, first_tile, is_alive, masks, tile_blocks
from common.rasterizer.cpu_workspace import (
    KEYS,
    LATER,
    RECORD,
    RECORD_DEPTH,
    RECORD_NORMAL,
    TILE_STATE,
    Depths,
    Workspace,
)
from common.rasterizer.simd_memory import compress, load_bits, load_f16, load_i16, prefetch, store_f16, store_i16
from common.rasterizer.simd_types import (
    bit_pattern,
    count_bits,
    f16,
    float_of_bits,
    fma,
    fnma,
    has_bit,
    integer_where,
    lane_number,
    lowest_bit,
    mask_bits,
    minimum,
    nearest,
    to_float,
    truncate,
    where,
)

Integers = npt.NDArray[np.int64]
Singles = npt.NDArray[np.float32]

LOG2_ALPHA_MIN = -7.994353436858858
BATCH = 32
"""Entries of a tile that are spread to its blocks' lists at a time."""
LIST = 64
"""Room of one block's list: a batch and the lanes that a store writes beyond it."""
DIGIT_BITS = 9
DIGITS = 1 << DIGIT_BITS
SORTED_BITS = 3 * DIGIT_BITS


@kernel
def begin_image(width: int, height: int, ws: Workspace) -> None:
    """Forget the last image: black, transparent, all blocks of pixels alive."""
    columns = (width + 15) >> 4
    ws.counts[:] = 0
    for tile in range(len(ws.tile_start) - 1):
        blocks_x = min(((width + 3) >> 2) - 4 * (tile % columns), 4)
        blocks_y = min(((height + 3) >> 2) - 4 * (tile // columns), 4)
        ws.tile_alive[tile] = tile_blocks(0, blocks_x - 1, 0, blocks_y - 1, 0, 0)
        for block in range(16):
            place = tile * TILE_STATE + block * 64
            for channel in range(3):
                store_f16(ws.tile_state, place + 16 * channel, f16(0.0))
            store_f16(ws.tile_state, place + 48, f16(1.0))


@kernel
def begin_slab(width: int, limit_bits: int, ws: Workspace) -> None:
    """Start a slab with those of the Gaussians projected earlier that lie before its limit."""
    columns = (width + 15) >> 4
    ws.tile_count[:] = 0
    waiting = ws.counts[LATER]
    kept, drawn = 0, 0
    for i in range(waiting):
        key = ws.later[i]
        if (key >> 32) >= limit_bits:
            ws.later[kept] = key
            kept += 1
            continue
        record = key & 0xFFFFFFFF
        code = np.int64(ws.codes[record])
        alive = is_alive(ws, columns, code, record)
        ws.keys[drawn] = key
        count_entries(ws, columns, code, record, alive)
        drawn += alive
    ws.counts[KEYS], ws.counts[LATER] = drawn, kept


@kernel
def sort_keys(ws: Workspace) -> bool:
    """Sort the slab's keys by depth, equal depths in order of projection; True if the result is in `sorted_keys`.

    A radix sort of the depths' bits above the slab's nearest. Beyond 27 bits, a depth ratio of 65536, the lowest bits
    are dropped.
    """
    n = ws.counts[KEYS]
    if n == 0:
        return False
    low, high = ws.keys[0] >> 32, ws.keys[0] >> 32
    for i in range(n):
        depth = ws.keys[i] >> 32
        low, high = min(low, depth), max(high, depth)
    bits = 0
    while (high - low) >> bits:
        bits += 1
    drop = max(bits - SORTED_BITS, 0) + 32
    passes = (min(bits, SORTED_BITS) + DIGIT_BITS - 1) // DIGIT_BITS
    base = low << 32
    places = ws.digit_places
    places[:] = 0
    for i in range(n):
        depth = (ws.keys[i] - base) >> drop
        places[0, depth & (DIGITS - 1)] += 1
        places[1, (depth >> DIGIT_BITS) & (DIGITS - 1)] += 1
        places[2, depth >> (2 * DIGIT_BITS)] += 1
    source, target = ws.keys, ws.sorted_keys
    for digit in range(passes):
        place, shift = places[digit], drop + digit * DIGIT_BITS
        first = 0
        for value in range(DIGITS):
            first, place[value] = first + place[value], first
        for i in range(n):
            key = source[i]
            value = ((key - base) >> shift) & (DIGITS - 1)
            target[place[value]] = key
            place[value] += 1
        source, target = target, source
    return passes % 2 == 1


@kernel
def begin_tiles(ws: Workspace) -> int:
    """Lay out the slab's lists one after the other; the number of places that they take."""
    tiles, stride = len(ws.tile_start) - 1, len(ws.tile_alive)
    counts = ws.tile_count
    first = 0
    for tile in range(tiles):
        ws.tile_start[tile] = first
        ws.tile_place[tile] = first
        size = counts[tile] + counts[stride + tile] + counts[2 * stride + tile] + counts[3 * stride + tile]
        # One place of slack per tile: the write of an entry that does not exist must not hit the next list.
        first += size + 1
    ws.tile_start[tiles] = first
    for k in range(3):
        ws.tile_place[tiles + k] = first + k
    return first + 3


@kernel
def fill_tiles(width: int, in_sorted: bool, ws: Workspace) -> None:
    """Spread the sorted keys to lists per tile."""
    columns, tiles = (width + 15) >> 4, len(ws.tile_start) - 1
    keys = ws.sorted_keys if in_sorted else ws.keys
    n = ws.counts[KEYS]
    place = ws.tile_place
    for i in range(n):
        prefetch(ws.codes, keys[min(i + 16, n - 1)] & 0xFFFFFFFF)
        record = keys[i] & 0xFFFFFFFF
        code = np.int64(ws.codes[record])
        if code == LARGE:
            _fill_large(record, columns, ws)
            continue
        tile = first_tile(code)
        here, right, below, beyond = masks(code, ws.row_masks)
        # Four writes in any case: cheaper than branches that the CPU cannot foresee.
        _write_entry(ws, place, tile, record, here, 1)
        _write_entry(ws, place, tile + 1 if right else tiles, record, right, 1 if right else 0)
        _write_entry(ws, place, tile + columns if below else tiles + 1, record, below, 1 if below else 0)
        _write_entry(ws, place, tile + columns + 1 if beyond else tiles + 2, record, beyond, 1 if beyond else 0)


@inlined
def _write_entry(ws: Workspace, place: Integers, tile: int, record: int, blocks: int, exists: int) -> None:
    p = place[tile]
    place[tile] = p + exists
    ws.entry_record[p] = record
    ws.entry_blocks[p] = blocks


@inlined
def _fill_large(record: int, columns: int, ws: Workspace) -> None:
    x0, x1, y0, y1 = bounds(ws.records, record)
    for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
        for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
            blocks = tile_blocks(x0, x1, y0, y1, tile_x, tile_y)
            _write_entry(ws, ws.tile_place, tile_y * columns + tile_x, record, blocks, 1)


@inlined
def _exp2(t: Any) -> Any:
    """2^t for t in -126..1, relative error below 2e-6."""
    whole = nearest(t)
    f = t - whole
    p = fma(f, 0.00956051021, 0.0559170392)
    p = fma(p, f, 0.240249811)
    p = fma(p, f, 0.693121968)
    p = fma(p, f, 0.999999191)
    return float_of_bits(bit_pattern(p) + (truncate(whole) << 23))


@inlined
def _blend_block(
    ws: Workspace, depths: Depths | None, normals: Singles | None, place: int, first: int, end: int, x: Any, y: Any
) -> bool:
    """Blend the records lists[first:end] into a 4x4 block of pixels; True if a pixel is not finished.

    Where `depths` or `normals` is None, the compiled code has no trace of it.
    """
    state = ws.tile_state
    red, green = load_f16(state, place), load_f16(state, place + 16)
    blue, transmittance = load_f16(state, place + 32), load_f16(state, place + 48)
    records = ws.records
    if depths is not None:
        depth, median = load_f16(depths.weighted_m, place >> 2), load_i16(depths.median, place >> 2)
    if normals is not None:
        n = 3 * (place >> 2)
        normal_x, normal_y, normal_z = load_f16(normals, n), load_f16(normals, n + 16), load_f16(normals, n + 32)
    for i in range(first, end):
        r = np.int64(ws.lists[i]) * RECORD
        dx, dy = x - records[r], y - records[r + 1]
        t = fma(dx, fma(dx, records[r + 2], dy * records[r + 3]), fma(dy * records[r + 4], dy, records[r + 5]))
        alpha = where(t >= LOG2_ALPHA_MIN, minimum(_exp2(t), ALPHA_MAX), 0.0)
        weight = alpha * transmittance
        red, green, blue = (
            fma(weight, records[r + 6], red),
            fma(weight, records[r + 7], green),
            fma(weight, records[r + 8], blue),
        )
        if depths is not None:
            # Not for finished pixels: a sky at 1.8 km would move even a weight of TRANSMITTANCE_MIN by 0.2 m.
            unfinished = transmittance >= TRANSMITTANCE_MIN
            depth = where(unfinished, fma(weight, records[r + RECORD_DEPTH], depth), depth)
            # Every Gaussian of the list while half of the light is left; the last of them takes it below.
            median = integer_where(transmittance >= 0.5, ws.lists[i], median)
        if normals is not None:
            normal_x, normal_y, normal_z = (
                fma(weight, records[r + RECORD_NORMAL], normal_x),
                fma(weight, records[r + RECORD_NORMAL + 1], normal_y),
                fma(weight, records[r + RECORD_NORMAL + 2], normal_z),
            )
        transmittance = fnma(alpha, transmittance, transmittance)
    store_f16(state, place, red)
    store_f16(state, place + 16, green)
    store_f16(state, place + 32, blue)
    store_f16(state, place + 48, transmittance)
    if depths is not None:
        store_f16(depths.weighted_m, place >> 2, depth)
        store_i16(depths.median, place >> 2, median)
    if normals is not None:
        store_f16(normals, n, normal_x)
        store_f16(normals, n + 16, normal_y)
        store_f16(normals, n + 32, normal_z)
    return bool(mask_bits(transmittance >= TRANSMITTANCE_MIN) != 0)


@inlined
def _fill_lists(ws: Workspace, entry: int, n: int, sizes: Integers) -> None:
    """Write the records of a batch of `n` entries to the lists of the blocks that they touch."""
    sizes[:] = 0
    for j in range(0, n, 16):
        records, blocks = load_i16(ws.entry_record, entry + j), load_bits(ws.entry_blocks, entry + j)
        valid = lane_number() < n - j
        for block in range(16):
            touched = has_bit(blocks, 1 << block) & valid
            size = sizes[block]
            store_i16(ws.lists, block * LIST + size, compress(touched, records))
            sizes[block] = size + count_bits(mask_bits(touched))


@kernel
def blend_tiles(width: int, ws: Workspace, depths: Depths | None, normals: Singles | None) -> int:
    """Blend the slab's lists into the tiles, nearest first; the number of entries that were looked at.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are.

    Args:
        width: Image width [px].
        ws: Workspace.
        depths: Where depths are summed up, if they are wanted.
        normals: Where normals are summed up, if they are wanted.
    """
    columns = (width + 15) >> 4
    sizes = ws.list_sizes
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    looked_at = 0
    for tile in range(len(ws.tile_start) - 1):
        alive = ws.tile_alive[tile]
        left, top = (tile % columns) * 16, (tile // columns) * 16
        entry, end = ws.tile_start[tile], ws.tile_start[tile + 1] - 1
        while entry < end and alive:
            n = min(BATCH, end - entry)
            _fill_lists(ws, entry, n, sizes)
            for i in range(entry + BATCH, min(end, entry + 2 * BATCH)):
                prefetch(ws.records, np.int64(ws.entry_record[i]) * RECORD)
            waiting = alive
            while waiting:
                block = lowest_bit(waiting)
                waiting &= waiting - 1
                x = lane_x + np.float32(left + 4 * (block & 3))
                y = lane_y + np.float32(top + 4 * (block >> 2))
                place, first = tile * TILE_STATE + block * 64, block * LIST
                if not _blend_block(ws, depths, normals, place, first, first + sizes[block], x, y):
                    alive &= ~(1 << block)
            entry += BATCH
            looked_at += n
        ws.tile_alive[tile] = alive
    return looked_at


@kernel
def write_floats(width: int, ws: Workspace, rgb: Singles) -> None:
    """Copy the tiles' colours to an image, shape (H, W, 3)."""
    columns = (width + 15) >> 4
    for v in range(rgb.shape[0]):
        for u in range(width):
            tile = (v >> 4) * columns + (u >> 4)
            place = tile * TILE_STATE + (((v >> 2) & 3) * 4 + ((u >> 2) & 3)) * 64 + (v & 3) * 4 + (u & 3)
            for channel in range(3):
                rgb[v, u, channel] = ws.tile_state[place + 16 * channel]


@kernel
def write_bytes(width: int, ws: Workspace, rgb: npt.NDArray[np.uint8]) -> None:
    """Copy the tiles' colours to an image of bytes, rounded and clipped, shape (H, W, 3)."""
    columns = (width + 15) >> 4
    for v in range(rgb.shape[0]):
        for u in range(width):
            tile = (v >> 4) * columns + (u >> 4)
            place = tile * TILE_STATE + (((v >> 2) & 3) * 4 + ((u >> 2) & 3)) * 64 + (v & 3) * 4 + (u & 3)
            for channel in range(3):
                value = ws.tile_state[place + 16 * channel] * np.float32(255.0) + np.float32(0.5)
                rgb[v, u, channel] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
