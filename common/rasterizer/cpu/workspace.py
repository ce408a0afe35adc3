"""Memory of the CPU rasterizer that is reused for every image, and the places of what kernels keep in it.

Legend of the kernels in this folder:

    lane     one of the 16 numbers of a SIMD value (F16, I16, M16 of `simd.types`)
    block    of Gaussians: 16 neighbours of a pack, one per lane; of pixels: 4x4, one per lane, row by row
    tile     16x16 px, 4x4 blocks; bit 4 * row + column of a mask stands for a block
    record   a projected Gaussian, `RECORD` numbers
    key      depth bits << 32 | number of the record: as integers keys sort by depth
    entry    a record in a tile's list, with the mask of the tile's blocks that its box touches
    node     64 entries that follow each other; a tile's list is a chain of nodes
    slab     a range of depths that is drawn in one go, nearest slabs first
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array, Int32Array, Int64Array, UInt16Array
from readygo.common.simd.types import LANES

RECORD = 16
"""Float32 numbers per projected Gaussian, one cache line; the constants below are places in it, 10, 11 and 15 unused.

While 16 Gaussians are projected, row k of the scratch memory holds number k of their records, one lane each."""
RECORD_X, RECORD_Y = 0, 1
"""Mean in the image [px]."""
RECORD_A, RECORD_B, RECORD_C = 2, 3, 4
"""log2(alpha) = A dx^2 + B dx dy + C dy^2 + log2(opacity) at an offset (dx, dy) from the mean: -log2(e) / 2 times the
entries xx, 2 xy and yy of the inverse image covariance [1/px2]."""
RECORD_OPACITY = 5
"""Binary logarithm of the opacity."""
RECORD_RED, RECORD_GREEN, RECORD_BLUE = 6, 7, 8
RECORD_DEPTH = 9
"""Depth of the mean [m]."""
RECORD_NORMAL = 12
"""Normal x, y, z towards the camera in its frame, if it was asked for."""
BOX = 2
"""Numbers per box, see `tiles`: first tile, then blocks."""
BITS_TILE, BITS_LOW, BITS_HIGH, BITS_DEPTH = 0, LANES, 2 * LANES, 3 * LANES
"""Rows of `scratch_bits`: first tiles, low and high half of the blocks, depth bits."""
DEPTH_SHIFT = 32
"""Where a key's depth bits begin."""
RECORD_MASK = 0xFFFFFFFF
"""Bits of a key that hold the number of the record."""
TILE_BITS = 4
TILE = 1 << TILE_BITS
"""Pixels along a tile's side."""
BLOCK_BITS = 2
BLOCK = 1 << BLOCK_BITS
"""Pixels along the side of a block."""
TILE_BLOCKS = 16
"""Blocks of a tile."""
MAX_SIDE_PX = 4 * 65535
"""Longest side of an image: numbers of 4-px blocks take 16 bits."""
STATE_RED, STATE_GREEN, STATE_BLUE, STATE_TRANSMITTANCE = 0, LANES, 2 * LANES, 3 * LANES
"""Rows of a block's state: 4x4 px of each."""
BLOCK_STATE = 4 * LANES
"""Float32 numbers of a block's state."""
TILE_STATE = TILE_BLOCKS * BLOCK_STATE
"""Those of a tile's."""
NODE_BITS = 6
NODE = 1 << NODE_BITS
"""Entries per node of the tiles' lists, one bit each of an int64."""
DIGIT_BITS = 12
DIGITS = 1 << DIGIT_BITS
"""Most values that a digit of the depth sort can have."""
RECORDS, KEYS, LATER, LARGE_ENTRIES = 0, 1, 2, 3
"""Places in `counts`."""


class Workspace(NamedTuple):
    """Buffers for one camera at a time; numbers are in `counts`."""

    counts: Int64Array
    """Numbers of records, of keys for this slab, of keys for later slabs, and of the tiles that all boxes of more than
    2x2 tiles meet, shape (4,)."""
    records: Float32Array
    """Projected Gaussians, shape (N * RECORD,)."""
    boxes: Int64Array
    """First tile and blocks of their boxes (see `tiles`), shape (N * BOX,)."""
    keys: Int64Array
    """Keys of what this slab draws, shape (N,)."""
    sorted_keys: Int64Array
    """The keys of this slab sorted by depth, shape (N,)."""
    later: Int64Array
    """Keys of what lies beyond the slab, shape (N,)."""
    tile_place: Int64Array
    """Where each tile's next entry goes, and three places for entries that do not exist, shape (T + 3,)."""
    tile_alive: Int64Array
    """Bit k is set while the tile's 4x4 block k is not finished; 0 beyond the image, shape (T + slack,)."""
    quad_alive: Int64Array
    """Unfinished blocks of a tile and its neighbours, laid out as a box's blocks, shape (T,)."""
    tile_state: Float32Array
    """Colour and transmittance, shape (T * TILE_STATE,)."""
    node_next: Int64Array
    """The node that follows each node of a tile's list; the first T nodes begin the lists, shape (E / 64,)."""
    entry_record: Int32Array
    """Record numbers of the entries, nearest first within a tile, shape (E,)."""
    entry_blocks: UInt16Array
    """Blocks of the tile that the entry touches, shape (E,)."""
    digit_places: Int32Array
    """Where the sort's next key of each digit value goes, shape (3 * 4096,)."""
    scratch: Float32Array
    """A 16x16 matrix: the records of a block of Gaussians, number by number, shape (256,)."""
    scratch_bits: Int32Array
    """Rows `BITS_TILE` to `BITS_DEPTH` of a block of Gaussians, shape (64,)."""
    scratch_records: Float32Array
    """Records of a block of Gaussians, one after the other, shape (256,)."""


class Depths(NamedTuple):
    """What is kept per pixel for depths and the mask; per tile 16 blocks of 4x4 px."""

    weighted_m: Float32Array
    """Sum of depths, weighted as colours are [m], shape (T * 256,)."""
    median: Int32Array
    """Record number of the median Gaussian where the transmittance is below one half, shape (T * 256,)."""


def make_depths(height_px: int, width_px: int) -> Depths:
    """Memory for the depths of images of one size."""
    pixels = tile_count(height_px, width_px) * TILE * TILE
    return Depths(_allocate_aligned(pixels, np.float32), _allocate_aligned(pixels, np.int32))


def make_normals(height_px: int, width_px: int) -> Float32Array:
    """Memory for sums of normals, per tile 16 blocks of x, y, z of 4x4 px, shape (T * 768,)."""
    return _allocate_aligned(tile_count(height_px, width_px) * TILE * TILE * 3, np.float32)


def make_workspace(height_px: int, width_px: int) -> Workspace:
    """A workspace for images of one size; see `with_room`."""
    tiles, slack = tile_count(height_px, width_px), -(-width_px // TILE) + 1
    ws = Workspace(
        counts=np.zeros(4, dtype=np.int64),
        records=_allocate_aligned(0, np.float32),
        boxes=_allocate_aligned(0, np.int64),
        keys=_allocate_aligned(0, np.int64),
        sorted_keys=_allocate_aligned(0, np.int64),
        later=_allocate_aligned(0, np.int64),
        tile_place=_allocate_aligned(tiles + 3, np.int64),
        tile_alive=np.zeros(tiles + slack, dtype=np.int64),
        quad_alive=np.zeros(tiles, dtype=np.int64),
        tile_state=_allocate_aligned(tiles * TILE_STATE, np.float32),
        node_next=_allocate_aligned(0, np.int64),
        entry_record=_allocate_aligned(0, np.int32),
        entry_blocks=_allocate_aligned(0, np.uint16),
        digit_places=_allocate_aligned(3 * DIGITS, np.int32),
        scratch=_allocate_aligned(256, np.float32),
        scratch_bits=_allocate_aligned(64, np.int32),
        scratch_records=_allocate_aligned(16 * RECORD, np.float32),
    )
    return with_room(ws, records=1, entries=1)


def with_room(ws: Workspace, *, records: int = 0, entries: int = 0) -> Workspace:
    """The workspace, with larger buffers where these numbers do not fit; contents of replaced buffers are lost.

    Args:
        ws: What there is.
        records: Projected Gaussians of an image.
        entries: Entries of a slab in all tiles' lists.
    """
    if BOX * records > len(ws.boxes):
        room = records + records // 4
        ws = ws._replace(
            records=_allocate_aligned(room * RECORD, np.float32),
            boxes=_allocate_aligned(room * BOX, np.int64),
            keys=_allocate_aligned(room, np.int64),
            sorted_keys=_allocate_aligned(room, np.int64),
            later=_allocate_aligned(room, np.int64),
        )
    nodes = entries // NODE + 2 * len(ws.quad_alive) + 1
    if entries and nodes > len(ws.node_next):
        room = nodes + nodes // 4
        ws = ws._replace(
            node_next=_allocate_aligned(room, np.int64),
            entry_record=_allocate_aligned(room * NODE, np.int32),
            entry_blocks=_allocate_aligned(room * NODE, np.uint16),
        )
    return ws


def tile_count(height_px: int, width_px: int) -> int:
    """Number of tiles of an image."""
    return -(-height_px // TILE) * -(-width_px // TILE)


def _allocate_aligned(count: int, dtype: npt.DTypeLike) -> AnyArray:
    """Uninitialised array that begins on a cache line and has room for one more SIMD register behind its end."""
    size = count * np.dtype(dtype).itemsize
    raw = np.empty(size + 128, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype)
