"""Slabs of depth, drawn nearest first, so that what lies behind finished pixels is neither projected nor sorted."""

import itertools
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.constants import NEAR_M
from readygo.common.rasterizer.cpu.tiles import any_alive

SLAB_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Shares of the visible chunks, nearest first, at which one slab ends and the next begins."""
SLAB_MIN_CHUNKS = 64
"""Fewer chunks are not worth a slab."""
NEAR_BITS = int(np.float32(NEAR_M).view(np.int32))
FAR_BITS = 1 << 31
"""Above the depth bits of every key."""


class Slab(NamedTuple):
    """A range of depths that is drawn in one go."""

    first_m: float
    """Chunks whose means may lie nearer were projected before [m]."""
    limit_m: float
    """Chunks whose means all lie beyond wait for a later slab [m]."""
    limit_bits: int
    """Depth bits of the keys that wait for a later slab: those of `limit_m`, above those of the near plane."""
    cull: bool
    """True if some pixels may be finished."""


def slabs_of(depth_m: Float64Array, shares: tuple[float, ...] | None = None) -> list[Slab]:
    """Split the depths of the visible chunks [m] at these shares of them, or at those of `SLAB_SHARES`."""
    shares = SLAB_SHARES if shares is None else shares
    depths = np.sort(depth_m)
    limits = {float(depths[int(share * len(depths))]) for share in shares} if len(depths) > SLAB_MIN_CHUNKS else ()
    edges = [-np.inf, *sorted(limit for limit in limits if limit > NEAR_M), np.inf]
    return [
        Slab(first, limit, _depth_bits(limit), number > 0)
        for number, (first, limit) in enumerate(itertools.pairwise(edges))
    ]


def _depth_bits(depth_m: float) -> int:
    return FAR_BITS if depth_m == np.inf else int(np.float32(depth_m).view(np.int32)) - NEAR_BITS


@inline_kernel
def is_due(slab: Slab, depth_m: float, box: int, columns: int, tile_alive: Int64Array) -> bool:
    """True if a chunk belongs to the slab and some pixel that it may touch is not finished.

    Args:
        slab: Depths that are drawn now.
        depth_m: Lower bound of the depths of the chunk's means [m].
        box: Bounds of its footprints, packed as in `tiles.pack_box`.
        columns: Tiles along an image row.
        tile_alive: Unfinished blocks of the tiles.
    """
    if not slab.first_m <= depth_m < slab.limit_m:
        return False
    if not slab.cull:
        return True
    return bool(any_alive(tile_alive, columns, box))
