"""Forward blending of the tiles' lists into planes: transmittance, colour, depth and any number of features."""

from typing import Any

import numpy as np

from common.rasterizer.compilation import inlined, kernel
from common.rasterizer.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from common.rasterizer.cpu_blend import BATCH, LIST, LOG2_ALPHA_MIN, _exp2, _fill_lists
from common.rasterizer.cpu_workspace import RECORD, Workspace
from common.rasterizer.differentiable.memory import DEPTH, FEATURE_GROUP, PLANES, RED, TRANSMITTANCE, Kept, Raster
from common.rasterizer.differentiable.simd_rows import store_block
from common.rasterizer.simd_memory import load_f16, prefetch, store_f16
from common.rasterizer.simd_types import f16, fma, fnma, lane_number, lowest_bit, mask_bits, minimum, to_float, where


@inlined
def alive_blocks(width: int, height: int, left: int, top: int) -> int:
    """Bits of a tile's 4x4 blocks that hold pixels of the image."""
    blocks_x, blocks_y = min((width - left + 3) >> 2, 4), min((height - top + 3) >> 2, 4)
    row = (1 << blocks_x) - 1
    return row * (0x1111 & ((1 << (4 * blocks_y)) - 1))


@kernel
def gather_features(features: Any, count: int, records: int, kept: Kept, raster: Raster) -> None:
    """Copy the features of the Gaussians that are drawn, `count` numbers each, and fill rows up with zeros."""
    stride = raster.feature_count
    for record in range(records):
        row = np.int64(kept.index[record]) * count
        for k in range(stride):
            raster.features[record * stride + k] = features[row + k] if k < count else np.float32(0.0)


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
        weight = alpha * transmittance
        red, green, blue, depth = (
            fma(weight, records[r + 6], red),
            fma(weight, records[r + 7], green),
            fma(weight, records[r + 8], blue),
            fma(weight, records[r + 9], depth),
        )
        transmittance = fnma(alpha, transmittance, transmittance)
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
def _store_tile(raster: Raster, left: int, top: int, planes: int) -> None:
    """Copy the state of a tile's blocks to the planes."""
    size = raster.height * raster.stride
    for block in range(16):
        pixel = (top + 4 * (block >> 2)) * raster.stride + left + 4 * (block & 3)
        for plane in range(planes):
            value = load_f16(raster.state, (block * planes + plane) * 16)
            store_block(raster.planes, plane * size + pixel, raster.stride, value)


@kernel
def blend(width: int, height: int, ws: Workspace, raster: Raster) -> None:
    """Blend the tiles' lists, nearest first, and note where each 4x4 block of pixels was finished.

    A block is left alone once all of its pixels are finished, a tile once all of its blocks are; both are asked after
    every `BATCH` entries.
    """
    columns, planes = (width + 15) >> 4, PLANES + raster.feature_count
    sizes = ws.list_sizes
    lane_x, lane_y = to_float(lane_number() & 3) + 0.5, to_float(lane_number() >> 2) + 0.5
    for tile in range(len(ws.tile_start) - 1):
        left, top = (tile % columns) * 16, (tile // columns) * 16
        alive = alive_blocks(width, height, left, top)
        entry, end = ws.tile_start[tile], ws.tile_start[tile + 1] - 1
        for block in range(16):
            for plane in range(planes):
                store_f16(raster.state, (block * planes + plane) * 16, f16(1.0 if plane == TRANSMITTANCE else 0.0))
            raster.block_end[tile * 16 + block] = end if (alive >> block) & 1 else 0
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
                place, first = block * planes * 16, block * LIST
                unfinished = _blend_block(ws, raster, place, first, first + sizes[block], x, y)
                if raster.feature_count:
                    _blend_features(ws, raster, place, first, first + sizes[block])
                if not unfinished:
                    alive &= ~(1 << block)
                    raster.block_end[tile * 16 + block] = entry + n
            entry += BATCH
        _store_tile(raster, left, top, planes)
