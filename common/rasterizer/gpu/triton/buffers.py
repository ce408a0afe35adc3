"""Memory between the Triton kernels; it grows when a batch needs more."""

from dataclasses import dataclass

import torch
from torch import Tensor

from readygo.common.errors import ReadygoError
from readygo.common.rasterizer.gpu.triton.project import RECORD
from readygo.common.rasterizer.packed.scene import CHUNK

MAX_PAIRS = 2**31 // CHUNK - 1
"""Most pairs: slots are numbered with 31 bits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Buffers:
    """What `project`, `bin_entries` and `sort_lists` write; N pairs of a camera and a chunk, E entries of tiles."""

    pairs: Tensor
    """Numbers of visible instances of chunks, camera * I + instance, int32, shape (N,)."""
    owners: Tensor
    """Number of each pair's human, from 1; 0: the scene; int32, shape (N,)."""
    records: Tensor
    """Projected Gaussians, float32, shape (N * 256, RECORD)."""
    record_normals: Tensor
    """Normals towards the camera, in its frame, float32, shape (N * 256, 4), or (1, 4) if no normals are drawn."""
    rects: Tensor
    """Tiles of each Gaussian, packed, or UNSEEN, int32, shape (N * 256,)."""
    depths: Tensor
    """Depth of each Gaussian [m], float32, shape (N * 256,)."""
    entries: Tensor
    """Depth bits and slots of the Gaussians in the tiles' lists, int64, shape (E,)."""
    spare: Tensor
    """Second memory of the same size, which merging sorted runs writes to, int64, shape (E,)."""

    @property
    def pair_capacity(self) -> int:
        """Room for pairs, N."""
        return len(self.pairs)

    @property
    def entry_capacity(self) -> int:
        """Room for entries, E."""
        return len(self.entries)


def make_buffers(pair_capacity: int, entry_capacity: int, normals: bool, device: torch.device) -> Buffers:
    """Buffers of at least one pair and one entry.

    Raises:
        ReadygoError: If more chunks are visible than slots can be numbered.
    """
    pairs, entries = max(pair_capacity, 1), max(entry_capacity, 1)
    if pairs > MAX_PAIRS:
        raise ReadygoError(
            f"One pass can draw {MAX_PAIRS} visible chunks of {CHUNK} Gaussians, got {pairs}; "
            "lower cameras_per_pass of the settings."
        )
    slots = pairs * CHUNK

    def empty(dtype: torch.dtype, *shape: int) -> Tensor:
        return torch.empty(shape, dtype=dtype, device=device)

    return Buffers(
        pairs=empty(torch.int32, pairs),
        owners=empty(torch.int32, pairs),
        records=empty(torch.float32, slots, RECORD),
        record_normals=empty(torch.float32, slots if normals else 1, 4),
        rects=empty(torch.int32, slots),
        depths=empty(torch.float32, slots),
        entries=empty(torch.int64, entries),
        spare=empty(torch.int64, entries),
    )
