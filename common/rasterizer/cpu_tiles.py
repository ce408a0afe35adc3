"""Which tiles and which 4x4 blocks of their pixels a Gaussian's box touches.

A box is kept as a 32-bit code: the number of the tile that holds its top left corner, and one bit per column and row of
the blocks that it covers there and in the next tiles to the right and below. Larger boxes have the code `LARGE` and are
read from their record.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from common.rasterizer.compilation import inlined
from common.rasterizer.cpu_workspace import RECORD, RECORD_BOUNDS_X, RECORD_BOUNDS_Y, Workspace
from common.rasterizer.simd_types import float_bits, integer_minimum, integer_where

Integers = npt.NDArray[np.int64]

LARGE = -1
"""Code of a box that meets more than 2x2 tiles."""
MAX_TILES = 65535


@inlined
def box_codes(x0: Any, x1: Any, y0: Any, y1: Any, columns: int) -> Any:
    """Codes (I16) of boxes whose bounds are given in blocks, both ends included (I16 each)."""
    across, down = integer_minimum(x1 - (x0 & -4), 8), integer_minimum(y1 - (y0 & -4), 8)
    first_column, first_row = 1 << (x0 & 3), 1 << (y0 & 3)
    column_bits, row_bits = (2 << across) - first_column, (2 << down) - first_row
    code = ((y0 >> 2) * columns + (x0 >> 2)) | (column_bits << 16) | (row_bits << 24)
    return integer_where((column_bits | row_bits) > 255, LARGE, code)


@inlined
def first_tile(code: int) -> int:
    """Number of the tile that holds the box's top left corner."""
    return code & 0xFFFF


@inlined
def masks(code: int, row_masks: Integers) -> tuple[int, int, int, int]:
    """Blocks that the box covers in its first tile, the one to the right, the one below, and the one right below."""
    left, right = (code >> 16) & 15, (code >> 20) & 15
    rows = row_masks[(code >> 24) & 255]
    upper, lower = rows & 0xFFFF, rows >> 16
    return left * upper, right * upper, left * lower, right * lower


@inlined
def bounds(records: npt.NDArray[np.float32], record: int) -> tuple[int, int, int, int]:
    """x0, x1, y0, y1 of a record's box in blocks, both ends included."""
    x = float_bits(records[record * RECORD + RECORD_BOUNDS_X])
    y = float_bits(records[record * RECORD + RECORD_BOUNDS_Y])
    return x & 0xFFFF, x >> 16, y & 0xFFFF, y >> 16


@inlined
def tile_blocks(x0: int, x1: int, y0: int, y1: int, tile_x: int, tile_y: int) -> int:
    """Which of a tile's 16 blocks lie within bounds that meet the tile; bit 4 * row + column."""
    left, right = max(x0 - 4 * tile_x, 0), min(x1 - 4 * tile_x, 3)
    top, bottom = max(y0 - 4 * tile_y, 0), min(y1 - 4 * tile_y, 3)
    row = ((2 << right) - 1) & ~((1 << left) - 1)
    rows = (0x1111 >> (4 * (3 - bottom))) & ~((1 << (4 * top)) - 1)
    return row * rows


@inlined
def any_alive(tile_alive: Integers, columns: int, x0: int, x1: int, y0: int, y1: int) -> bool:
    """True if a block within bounds is not finished."""
    for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
        for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
            if tile_alive[tile_y * columns + tile_x] & tile_blocks(x0, x1, y0, y1, tile_x, tile_y):
                return True
    return False


@inlined
def is_alive(ws: Workspace, columns: int, code: int, record: int) -> int:
    """1 if a block that the box covers is not finished, else 0."""
    if code == LARGE:
        x0, x1, y0, y1 = bounds(ws.records, record)
        return 1 if any_alive(ws.tile_alive, columns, x0, x1, y0, y1) else 0
    tile = first_tile(code)
    here, right, below, beyond = masks(code, ws.row_masks)
    alive = ws.tile_alive
    # `tile_alive` is longer than the image has tiles, so that the four can be read without asking whether they exist.
    common = (here & alive[tile]) | (right & alive[tile + 1])
    common |= (below & alive[tile + columns]) | (beyond & alive[tile + columns + 1])
    return 1 if common != 0 else 0


@inlined
def count_entries(ws: Workspace, columns: int, code: int, record: int, times: int) -> None:
    """Count `times` (0 or 1) entries for every tile that the box meets."""
    stride = len(ws.tile_alive)
    counts = ws.tile_count
    if code == LARGE:
        x0, x1, y0, y1 = bounds(ws.records, record)
        for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
            for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
                counts[tile_y * columns + tile_x] += np.int32(times)
        return
    tile = first_tile(code)
    across, down = np.int32((code >> 20) & 15 != 0) * times, np.int32((code >> 28) & 15 != 0)
    # Four counters per tile: neighbouring increments do not wait for each other.
    counts[tile] += np.int32(times)
    counts[stride + tile + 1] += np.int32(across)
    counts[2 * stride + tile + columns] += np.int32(down * times)
    counts[3 * stride + tile + columns + 1] += np.int32(across * down)
