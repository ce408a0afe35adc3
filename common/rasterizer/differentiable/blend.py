"""Forward blending of the tiles' lists into planes: transmittance, colour, depth and any number of features."""

from typing import Any

import numpy as np

from common.rasterizer.compilation import inlined, kernel
from common.rasterizer.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from common.rasterizer.cpu_blend import BATCH, LIST, LOG2_ALPHA_MIN, _exp2, _fill_lists
from common.rasterizer.cpu_workspace import RECORD, RECORDS, Workspace
from common.rasterizer.differentiable.memory import (
    DEPTH,
    FEATURE_GROUP,
    GROUP,
    NUMBER,
    PLANES,
    TRANSMITTANCE,
    Kept,
    Raster,
    Singles,
)
from common.rasterizer.differentiable.simd_rows import load_block, load_first, store_block, store_first
from common.rasterizer.simd_memory import load_f16, prefetch, store_f16
from common.rasterizer.simd_types import float_bits, fma, lane_number, lowest_bit, mask_bits, minimum, to_float, where


@inlined
def _alive_blocks(width: int, height: int, left: int, top: int) -> int:
    """Bits of a tile's 4x4 blocks that hold pixels of the image."""
    blocks_x, blocks_y = min((width - left + 3) >> 2, 4), min((height - top + 3) >> 2, 4)
    row = (1 << blocks_x) - 1
    return row * (0x1111 & ((1 << (4 * blocks_y)) - 1))


@kernel
def begin_planes(width: int, height: int, ws: Workspace, raster: Raster) -> None:
    """Forget the last image: black, transparent, all blocks of pixels alive."""
    columns = (width + 15) >> 4
    ws.counts[:] = 0
    for tile in range(len(ws.tile_start) - 1):
        ws.tile_alive[tile] = _alive_blocks(width, height, (tile % columns) * 16, (tile // columns) * 16)
    size = raster.height * raster.stride
    raster.planes[:] = np.float32(0.0)
    raster.planes[TRANSMITTANCE * size : (TRANSMITTANCE + 1) * size] = np.float32(1.0)


@kernel
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
def _blend_block(ws: Workspace, raster: Raster, place: int, first: int, end: int, x: Any, y: Any) -> bool:
    """Blend the records lists[first:end] into a 4x4 block of pixels; True if a pixel is not finished."""
    state, records, weights = raster.state, ws.records, raster.weights
    transmittance, depth = load_f16(state, place), load_f16(state, place + 16 * DEPTH)
    red, green, blue = load_f16(state, place + 16), load_f16(state, place + 32), load_f16(state, place + 48)
    keep_weights = raster.feature_count > 0
    for i in range(first, end):
        r = np.int64(ws.lists[i]) * RECORD
        dx, dy = x - records[r], y - records[r + 1]
        t = fma(dx, fma(dx, records[r + 2], dy * records[r + 3]), fma(dy * records[r + 4], dy, records[r + 5]))
        alpha = where(t >= LOG2_ALPHA_MIN, minimum(_exp2(t), ALPHA_MAX), 0.0)
        # Finished pixels stay as they are, even if their block goes on: a difference of `TRANSMITTANCE_MIN` behind an
        # alpha of 0.99 would be a hundred times larger in the gradient.
        weight = where(transmittance >= TRANSMITTANCE_MIN, alpha * transmittance, 0.0)
        red, green, blue, depth = (
            fma(weight, records[r + 6], red),
            fma(weight, records[r + 7], green),
            fma(weight, records[r + 8], blue),
            fma(weight, records[r + 9], depth),
        )
        transmittance = transmittance - weight
        if keep_weights:
            store_f16(weights, (i - first) * 16, weight)
    store_f16(state, place, transmittance)
    store_f16(state, place + 16, red)
    store_f16(state, place + 32, green)
    store_f16(state, place + 48, blue)
    store_f16(state, place + 16 * DEPTH, depth)
    return bool(mask_bits(transmittance >= TRANSMITTANCE_MIN) != 0)


@inlined
def _blend_features(ws: Workspace, raster: Raster, place: int, first: int, end: int) -> None:
    """Add the features of the records lists[first:end], whose weights are known, four at a time."""
    state, features = raster.state, raster.features
    for group in range(0, raster.feature_count, FEATURE_GROUP):
        p = place + 16 * (PLANES + group)
        a, b, c, d = load_f16(state, p), load_f16(state, p + 16), load_f16(state, p + 32), load_f16(state, p + 48)
        for i in range(first, end):
            r = np.int64(ws.lists[i]) * raster.feature_count + group
            weight = load_f16(raster.weights, (i - first) * 16)
            a, b, c, d = (
                fma(weight, features[r], a),
                fma(weight, features[r + 1], b),
                fma(weight, features[r + 2], c),
                fma(weight, features[r + 3], d),
            )
        store_f16(state, p, a)
        store_f16(state, p + 16, b)
        store_f16(state, p + 32, c)
        store_f16(state, p + 48, d)


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


@kernel
def blend(width: int, ws: Workspace, raster: Raster) -> None:
    """Blend the slab's lists into the planes, nearest first, and note where each 4x4 block of pixels was finished.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are; both are asked after
    every `BATCH` entries.
    """
    columns, planes = (width + 15) >> 4, PLANES + raster.feature_count
    sizes = ws.list_sizes
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    for tile in range(len(ws.tile_start) - 1):
        alive = ws.tile_alive[tile]
        entry, end = ws.tile_start[tile], ws.tile_start[tile + 1] - 1
        for block in range(16):
            raster.block_end[tile * 16 + block] = end if (alive >> block) & 1 else 0
        if entry >= end or alive == 0:
            continue
        left, top = (tile % columns) * 16, (tile // columns) * 16
        _copy_tile(raster, left, top, planes, False)
        while entry < end and alive:
            n = min(BATCH, end - entry)
            _fill_lists(ws, entry, n, sizes)
            for i in range(entry + BATCH, min(end, entry + 2 * BATCH)):
                record = np.int64(ws.entry_record[i])
                prefetch(ws.records, record * RECORD)
                if raster.feature_count:
                    prefetch(raster.features, record * raster.feature_count)
            waiting = alive
            while waiting:
                block = lowest_bit(waiting)
                waiting &= waiting - 1
                x, y = lane_x + (left + raster.block_x[block]), lane_y + (top + raster.block_y[block])
                place, first = block * planes * 16, block * LIST
                unfinished = _blend_block(ws, raster, place, first, first + sizes[block], x, y)
                if raster.feature_count:
                    _blend_features(ws, raster, place, first, first + sizes[block])
                if not unfinished:
                    alive &= ~(1 << block)
                    raster.block_end[tile * 16 + block] = entry + n
            entry += BATCH
        ws.tile_alive[tile] = alive
        _copy_tile(raster, left, top, planes, True)
