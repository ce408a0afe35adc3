"""Which tiles and which 4x4 blocks of their pixels a Gaussian's box touches.

A box is kept as two int64 numbers: the tile that holds its top left corner, and the blocks that it covers there, in the
next tile to the right, the one below and the one right below, 16 bits each. A box that meets more than these four
tiles has the tile `LARGE`, and its bounds, packed as in `pack_box`, instead of the blocks.

Legend: bounds x0, x1, y0, y1 count blocks of 4x4 px from the image's corner, both ends included; x >> 2 is the tile's
column, x & 3 the block's column in the tile. In the 16 bits of a tile, bit 4 * row + column stands for a block.
"""

from typing import Any

from readygo.common.arrays import Int64Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.cpu.workspace import Workspace
from readygo.common.simd.memory import peek
from readygo.common.simd.types import integer_minimum, integer_where

LARGE = -1
"""Tile of a box that meets more than 2x2 tiles."""


@inline_kernel
def pack_box(x0: int, x1: int, y0: int, y1: int) -> int:
    """Bounds in blocks of 4x4 px, both ends included, in one int64."""
    return x0 | (x1 << 16) | (y0 << 32) | (y1 << 48)


@inline_kernel
def unpack_box(box: int) -> tuple[int, int, int, int]:
    """x0, x1, y0, y1 of `pack_box`."""
    return box & 0xFFFF, (box >> 16) & 0xFFFF, (box >> 32) & 0xFFFF, (box >> 48) & 0xFFFF


@inline_kernel
def tiles_met(box: int) -> int:
    """Number of tiles that a packed box meets."""
    x0, x1, y0, y1 = unpack_box(box)
    count: int = ((x1 >> 2) - (x0 >> 2) + 1) * ((y1 >> 2) - (y0 >> 2) + 1)
    return count


@inline_kernel
def _spread(rows: Any) -> Any:
    """Bits 0..3 moved to 0, 4, 8, 12."""
    return (rows & 1) | ((rows & 2) << 3) | ((rows & 4) << 6) | ((rows & 8) << 9)


@inline_kernel
def box_codes(x0: Any, x1: Any, y0: Any, y1: Any, columns: int) -> Any:
    """Codes of boxes whose bounds are given in blocks, both ends included (I16 each).

    Returns:
        First tiles, and the low and the high half of the blocks (I16 each).
    """
    # Columns and rows from the first tile's corner to the last block; beyond 7 the box meets a third tile.
    across, down = integer_minimum(x1 - (x0 & -4), 8), integer_minimum(y1 - (y0 & -4), 8)
    first_column, first_row = 1 << (x0 & 3), 1 << (y0 & 3)
    # Bit k: column or row k of the 8 of two tiles is covered; 2^(last + 1) - 2^first.
    column_bits, row_bits = (2 << across) - first_column, (2 << down) - first_row
    large = (column_bits | row_bits) > 255
    # Columns of the first tile in bits 0..3, of the one right of it in bits 16..19. A product with the spread bits of
    # rows repeats them in every row: `low` has the upper two tiles, `high` the lower two.
    column_pair = (column_bits & 15) | ((column_bits & 240) << 12)
    low, high = column_pair * _spread(row_bits), column_pair * _spread(row_bits >> 4)
    tile = (y0 >> 2) * columns + (x0 >> 2)
    return (
        integer_where(large, LARGE, tile),
        integer_where(large, x0 | (x1 << 16), low),
        integer_where(large, y0 | (y1 << 16), high),
    )


@inline_kernel
def tile_blocks(x0: int, x1: int, y0: int, y1: int, tile_x: int, tile_y: int) -> int:
    """Which of a tile's 16 blocks lie within bounds that meet the tile; bit 4 * row + column."""
    left, right = max(x0 - 4 * tile_x, 0), min(x1 - 4 * tile_x, 3)
    top, bottom = max(y0 - 4 * tile_y, 0), min(y1 - 4 * tile_y, 3)
    # Bits left..right of one row, repeated in the rows top..bottom: 0x1111 has the first bit of every row.
    row = ((2 << right) - 1) & ~((1 << left) - 1)
    rows = (0x1111 >> (4 * (3 - bottom))) & ~((1 << (4 * top)) - 1)
    return row * rows


@inline_kernel
def any_alive(tile_alive: Int64Array, columns: int, box: int) -> bool:
    """True if a block within a packed box is not finished."""
    x0, x1, y0, y1 = unpack_box(box)
    for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
        for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
            if tile_alive[tile_y * columns + tile_x] & tile_blocks(x0, x1, y0, y1, tile_x, tile_y):
                return True
    return False


@inline_kernel
def is_alive(ws: Workspace, columns: int, tile: int, blocks: int) -> int:
    """1 if a block that the box covers is not finished, else 0."""
    if tile == LARGE:
        return 1 if any_alive(ws.tile_alive, columns, blocks) else 0
    return 1 if blocks & peek(ws.quad_alive, tile) else 0


@inline_kernel
def update_quads(ws: Workspace, columns: int) -> None:
    """Put together what is alive in each tile, right of it, below and right below, as in a box's blocks."""
    alive = ws.tile_alive
    # `tile_alive` is longer than the image has tiles, so that the four can be read without asking whether they exist.
    for tile in range(len(ws.quad_alive)):
        ws.quad_alive[tile] = (
            alive[tile] | (alive[tile + 1] << 16) | (alive[tile + columns] << 32) | (alive[tile + columns + 1] << 48)
        )
