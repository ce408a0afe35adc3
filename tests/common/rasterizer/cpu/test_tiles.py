import numpy as np
import pytest
from numba import njit

from readygo.common.rasterizer.cpu.tiles import (
    LARGE,
    any_alive,
    box_codes,
    is_alive,
    pack_box,
    tile_blocks,
    tiles_met,
    unpack_box,
    update_quads,
)
from readygo.common.rasterizer.cpu.workspace import make_workspace
from readygo.common.simd.memory import load_i16, store_i16

COLUMNS, ROWS = 5, 4
"""Tiles of the image."""


@njit
def _codes(bounds, columns, out):
    x0, x1, y0, y1 = load_i16(bounds, 0), load_i16(bounds, 16), load_i16(bounds, 32), load_i16(bounds, 48)
    tile, low, high = box_codes(x0, x1, y0, y1, columns)
    store_i16(out, 0, tile)
    store_i16(out, 16, low)
    store_i16(out, 32, high)


def boxes() -> np.ndarray:
    """Sixteen boxes in blocks, x0, x1, y0, y1: small ones, and some that meet more than 2x2 tiles."""
    rng = np.random.default_rng(2)
    first = rng.integers(0, (4 * COLUMNS - 8, 4 * ROWS - 8), size=(16, 2))
    last = first + rng.integers(0, 6, size=(16, 2))
    last[:3] = first[:3] + 8
    return np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1)


def covered(x0: int, x1: int, y0: int, y1: int, tile_x: int, tile_y: int) -> int:
    """The blocks of a tile within bounds, one by one."""
    return sum(
        1 << (4 * row + column)
        for row in range(4)
        for column in range(4)
        if x0 <= 4 * tile_x + column <= x1 and y0 <= 4 * tile_y + row <= y1
    )


def test_code_names_the_blocks_of_four_tiles_or_the_bounds_of_a_large_box() -> None:
    out = np.empty(48, np.int32)
    _codes(np.ascontiguousarray(boxes().T.reshape(-1), dtype=np.int32), COLUMNS, out)
    for (x0, x1, y0, y1), tile, low, high in zip(boxes().tolist(), *out.reshape(3, 16).tolist(), strict=True):
        blocks = (low & 0xFFFFFFFF) | ((high & 0xFFFFFFFF) << 32)
        x, y = x0 >> 2, y0 >> 2
        if (x1 >> 2) - x > 1 or (y1 >> 2) - y > 1:
            assert tile == LARGE
            assert blocks == pack_box(x0, x1, y0, y1)
            continue
        around = ((x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1))
        assert tile == y * COLUMNS + x
        assert blocks == sum(covered(x0, x1, y0, y1, *place) << (16 * k) for k, place in enumerate(around))


def test_box_comes_back_as_it_was_packed() -> None:
    assert unpack_box(pack_box(1, 65535, 3, 30000)) == (1, 65535, 3, 30000)


@pytest.mark.parametrize(("box", "count"), [((0, 3, 0, 3), 1), ((3, 4, 3, 4), 4), ((2, 13, 5, 6), 4)])
def test_tiles_of_a_box_are_counted(box: tuple[int, int, int, int], count: int) -> None:
    assert tiles_met(pack_box(*box)) == count


def test_blocks_of_a_tile_are_those_within_the_bounds() -> None:
    for bounds in boxes().tolist():
        x0, x1, y0, y1 = bounds
        for tile_y in range(y0 >> 2, (y1 >> 2) + 1):
            for tile_x in range(x0 >> 2, (x1 >> 2) + 1):
                assert tile_blocks(*bounds, tile_x, tile_y) == covered(*bounds, tile_x, tile_y)


@pytest.mark.parametrize("block", [(2, 3), (4, 3), (2, 4), (5, 4), (1, 3), (6, 4), (2, 5)])
def test_box_is_alive_if_one_of_its_blocks_is(block: tuple[int, int]) -> None:
    x0, x1, y0, y1 = 2, 5, 3, 4
    ws = make_workspace(16 * ROWS, 16 * COLUMNS)
    ws.tile_alive[(block[1] >> 2) * COLUMNS + (block[0] >> 2)] = 1 << (4 * (block[1] & 3) + (block[0] & 3))
    update_quads(ws, COLUMNS)
    alive = x0 <= block[0] <= x1 and y0 <= block[1] <= y1
    assert any_alive(ws.tile_alive, COLUMNS, pack_box(x0, x1, y0, y1)) == alive
    assert is_alive(ws, COLUMNS, LARGE, pack_box(x0, x1, y0, y1)) == alive
    around = ((0, 0), (1, 0), (0, 1), (1, 1))
    blocks = sum(covered(x0, x1, y0, y1, *place) << (16 * k) for k, place in enumerate(around))
    assert is_alive(ws, COLUMNS, 0, blocks) == alive
