"""Memory of the CPU rasterizer that is used anew for every image."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]
Singles = npt.NDArray[np.float32]

RECORD = 16
"""Float32 numbers per projected Gaussian, one cache line: centre x y [px]; -log2(e)/2 conic xx, -log2(e) conic xy,
-log2(e)/2 conic yy; log2 opacity; red, green, blue; depth [m]; first and last 4-px block in x and in y, as the bits of
two 16-bit numbers each; normal towards the camera, if it was asked for; the last is unused."""
RECORD_DEPTH, RECORD_BOUNDS_X, RECORD_BOUNDS_Y, RECORD_NORMAL = 9, 10, 11, 12
TILE = 16
"""Pixels along a tile's side."""
TILE_STATE = 1024
"""Per tile: 16 blocks of red, green, blue, transmittance, each of 4x4 px."""
RECORDS, KEYS, LATER = 0, 1, 2


class Workspace(NamedTuple):
    """Buffers for one camera at a time; numbers are in `counts`."""

    counts: Integers
    """Numbers of records, of keys for this slab, and of keys for later slabs, shape (3,)."""
    records: Singles
    """Projected Gaussians, shape (N * 16,)."""
    codes: npt.NDArray[np.int32]
    """Their boxes (see `cpu_tiles`), shape (N,)."""
    keys: Integers
    """Depth bits and record number of what this slab draws, shape (N,)."""
    sorted_keys: Integers
    """The same, sorted, shape (N,)."""
    later: Integers
    """Keys beyond the slab, shape (N,)."""
    tile_count: npt.NDArray[np.int32]
    """Entries per tile, four counters each, shape (4 * (T + slack),)."""
    tile_place: Integers
    """Where each tile's next entry goes, and three places for entries that do not exist, shape (T + 3,)."""
    tile_start: Integers
    """First entry of each tile, shape (T + 1,)."""
    tile_alive: Integers
    """Bit k is set while the tile's 4x4 block k is not finished; 0 beyond the image, shape (T + slack,)."""
    row_masks: Integers
    """Rows of blocks as bits of two tiles, see `_row_mask_table`, shape (256,)."""
    tile_state: Singles
    """Colour and transmittance, shape (T * 1024,)."""
    entry_record: npt.NDArray[np.int32]
    """Record numbers of all tiles' entries, nearest first within a tile, shape (E,)."""
    entry_blocks: npt.NDArray[np.uint16]
    """Blocks of the tile that the entry touches, shape (E,)."""
    lists: npt.NDArray[np.int32]
    """Records of one batch per block of a tile, shape (16 * 64,)."""
    list_sizes: Integers
    """Records in each list, shape (16,)."""
    digit_places: Integers
    """Where the sort's next key of each digit value goes, shape (3, 512)."""
    scratch: Singles
    """A 16x16 matrix, shape (256,)."""
    scratch_bits: npt.NDArray[np.int32]
    """Codes and depth bits of a block of Gaussians, shape (32,)."""


class Depths(NamedTuple):
    """What is kept per pixel for depths and the mask; per tile 16 blocks of 4x4 px."""

    weighted_m: Singles
    """Sum of depths, weighted as colours are [m], shape (T * 256,)."""
    median: npt.NDArray[np.int32]
    """Record number of the median Gaussian where the transmittance is below one half, shape (T * 256,)."""


def make_depths(height_px: int, width_px: int) -> Depths:
    """Memory for the depths of images of one size."""
    pixels = tile_count(height_px, width_px) * TILE * TILE
    return Depths(_aligned(pixels, np.float32), _aligned(pixels, np.int32))


def make_normals(height_px: int, width_px: int) -> Singles:
    """Memory for sums of normals, per tile 16 blocks of x, y, z of 4x4 px, shape (T * 768,)."""
    return _aligned(tile_count(height_px, width_px) * TILE * TILE * 3, np.float32)


def make_workspace(height_px: int, width_px: int, records: int, entries: int) -> Workspace:
    """A workspace for images of one size with room for `records` Gaussians and `entries` in the tiles' lists."""
    tiles, slack = tile_count(height_px, width_px), -(-width_px // TILE) + 1
    return Workspace(
        counts=np.zeros(3, dtype=np.int64),
        records=_aligned(records * RECORD, np.float32),
        codes=_aligned(records, np.int32),
        keys=_aligned(records, np.int64),
        sorted_keys=_aligned(records, np.int64),
        later=_aligned(records, np.int64),
        tile_count=_aligned(4 * (tiles + slack), np.int32),
        tile_place=_aligned(tiles + 3, np.int64),
        tile_start=_aligned(tiles + 1, np.int64),
        tile_alive=np.zeros(tiles + slack, dtype=np.int64),
        row_masks=_row_mask_table(),
        tile_state=_aligned(tiles * TILE_STATE, np.float32),
        entry_record=_aligned(entries, np.int32),
        entry_blocks=_aligned(entries, np.uint16),
        lists=_aligned(16 * 64, np.int32),
        list_sizes=_aligned(16, np.int64),
        digit_places=np.zeros((3, 512), dtype=np.int64),
        scratch=_aligned(256, np.float32),
        scratch_bits=_aligned(32, np.int32),
    )


def with_room(ws: Workspace, *, records: int = 0, entries: int = 0) -> Workspace:
    """The workspace, with larger buffers where these numbers do not fit; contents of replaced buffers are lost."""
    if records > len(ws.codes):
        room = records + records // 4
        ws = ws._replace(
            records=_aligned(room * RECORD, np.float32),
            codes=_aligned(room, np.int32),
            keys=_aligned(room, np.int64),
            sorted_keys=_aligned(room, np.int64),
            later=_aligned(room, np.int64),
        )
    if entries > len(ws.entry_record):
        room = entries + entries // 4
        ws = ws._replace(entry_record=_aligned(room, np.int32), entry_blocks=_aligned(room, np.uint16))
    return ws


def tile_count(height_px: int, width_px: int) -> int:
    """Number of tiles of an image."""
    return -(-height_px // TILE) * -(-width_px // TILE)


def _row_mask_table() -> Integers:
    """For eight rows of blocks in two tiles, one bit each: bits 0, 4, 8, 12 of the upper and, shifted by 16, lower."""
    table = np.zeros(256, dtype=np.int64)
    for rows in range(256):
        table[rows] = sum(1 << (4 * (row % 4) + 16 * (row // 4)) for row in range(8) if rows >> row & 1)
    return table


def _aligned(count: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Uninitialised array that begins on a cache line and has room for one more SIMD register behind its end."""
    size = count * np.dtype(dtype).itemsize
    raw = np.empty(size + 128, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype)
