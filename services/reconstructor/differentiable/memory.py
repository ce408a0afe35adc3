"""What the kernels of the differentiable rasterizer read and write, apart from the common workspace.

Legend of the kernels in this folder, besides that of `cpu.workspace`:

    group            up to 16 Gaussians of one chunk that were projected together, one per lane; `GROUP_ROWS` rows
    plane            an image of one number per pixel
    slope            derivative of the loss by a pixel's number in a plane
    gradient record  derivatives of the loss by what a record holds, summed over its pixels
    drawn, weighty   bits of the lanes that are drawn, and that have weight in the image
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array, UInt16Array
from readygo.common.simd.types import LANES
from readygo.services.reconstructor.differentiable.partial_sums import place_of

CHUNK = 256
"""Gaussians that follow each other in memory and are culled together."""
GROUP_ROWS = 23
"""What is kept of 16 Gaussians: offset from the camera (3), quaternion (4), scales (3), opacity, number, then
derivatives of red, green, blue by the offset (9), which of them are not black (bits), the larger half side of the box
[px], 0 where nothing is drawn."""
OFFSET, QUATERNION, SCALES, OPACITY, NUMBER, DERIVATIVES, COLOURED, RADIUS = 0, 3, 7, 10, 11, 12, 21, 22
"""Rows of a group."""
GROUP = GROUP_ROWS * LANES
"""Numbers per group of 16 Gaussians."""
TRANSMITTANCE, RED, DEPTH, PLANES = 0, 1, 4, 5
"""Planes of an image: transmittance, red, green, blue, depth times weight, and then the features."""
MOMENTS, WEIGHT, CHANNELS, FEATURES = (
    tuple(map(place_of, range(6))),
    place_of(6),
    tuple(map(place_of, range(7, 11))),
    LANES,
)
"""Places in a gradient record: six moments, the sum of weights, red, green, blue and depth, and where features begin.
Behind these are the absolute derivatives by the projected mean, if asked for. The other places below `FEATURES` hold
nothing of use."""
RED_CHANNEL, GREEN_CHANNEL, BLUE_CHANNEL, DEPTH_CHANNEL = 0, 1, 2, 3
"""Places in `CHANNELS`."""
COEFFICIENTS_MAX = 48
"""SH coefficients of a Gaussian at most: 16 of three colours."""
FEATURE_GROUP = 4
"""Features are handled in groups of this many; the last group is filled up with zeros."""


class Cloud(NamedTuple):
    """Parameters of N Gaussians as flat float32 arrays."""

    means_m: Float32Array
    quats_wxyz: Float32Array
    scales_m: Float32Array
    opacities: Float32Array
    sh: Float32Array
    """Coefficients, three colours each; empty if there is no colour."""
    sh_stride: int
    """Numbers per Gaussian in `sh`."""
    sh_count: int
    """Coefficients per colour that are used; 0: no colour."""


class Chunks(NamedTuple):
    """Chunks that may touch the image, in the order of memory."""

    number: Int64Array
    """Chunk numbers, shape (C,)."""
    depth_m: Float64Array
    """Lower bound of the depths of their means [m], shape (C,)."""
    box: Int64Array
    """Bounds of their footprints in 4x4 blocks, packed as in `pack_box`, shape (C,)."""
    lanes: Int64Array
    """Which Gaussians of each of their blocks of 16 may touch the image (bits), shape (C * 16,)."""
    first_group: Int64Array
    """First group of each chunk, shape (C,)."""
    group_count: Int64Array
    """Groups of each chunk; 0: nothing of it was projected, shape (C,)."""


class ForwardMemory(NamedTuple):
    """What the projection hands to the backward pass: groups of up to 16 Gaussians of one chunk.

    Record `16 * group + lane` is that of the group's Gaussian `lane`.
    """

    groups: Float32Array
    """Groups of 16 Gaussians, with the rows of `GROUP_ROWS`, shape (G * GROUP,)."""
    lanes: Int32Array
    """Gaussians of each group, shape (G,)."""
    waiting: Int64Array
    """Numbers of those Gaussians of one chunk that may touch the image, shape (CHUNK,)."""
    rows: Float32Array
    """Parameters or SH coefficients of 16 Gaussians, one row each, shape (16 * 48,)."""
    coefficients: Float32Array
    """SH coefficients of 16 Gaussians, one column each, shape (48 * 16,)."""


class Raster(NamedTuple):
    """Images and lists that forward and backward blending share."""

    planes: Float32Array
    """Images one after the other, with sides that are multiples of 16 px; see `PLANES`."""
    height: int
    """Rows of one plane [px]."""
    stride: int
    """Columns of one plane [px]."""
    features: Float32Array
    """Features of the records, shape (records * feature_count,)."""
    feature_count: int
    """Features per record, a multiple of `FEATURE_GROUP`."""
    tile_nodes: Int32Array
    """Nodes of each tile's list that were drawn until the tile was finished, shape (T,)."""
    entry_drawn: UInt16Array
    """Which of the tile's 4x4 blocks an entry of a drawn node changed (bits), shape (E,)."""
    weights: Float32Array
    """Alphas, then weights of a node's entries in one block, shape (64 * 16,)."""
    state: Float32Array
    """What a tile's blocks need while it is blended, shape (16 * (feature_count + 7) * 16,)."""
    block_x: Float32Array
    """Columns of a tile's blocks within it [px], shape (16,)."""
    block_y: Float32Array
    """Rows of a tile's blocks within it [px], shape (16,)."""


class Gradients(NamedTuple):
    """Derivatives of the loss: gradient records, and rows with room for 16 more.

    Parameters have a row per Gaussian with weight; weights and projected means one per Gaussian of a group.
    """

    records: Float32Array
    """Gradient records, see `MOMENTS`, shape (records * record_size,)."""
    record_size: int
    """Numbers per gradient record, a multiple of 16."""
    touched: UInt8Array
    """1 for groups of which a record was replayed; gradient records of the others hold nothing, shape (G,)."""
    sums: Float32Array
    """The first 16 numbers of 16 gradient records, one row each, shape (16 * 16,)."""
    numbers: Int64Array
    """Indices of the Gaussians that have weight, ascending."""
    means_m: Float32Array
    quats_wxyz: Float32Array
    scales_m: Float32Array
    opacities: Float32Array
    sh: Float32Array
    features: Float32Array
    feature_size: int
    """Features per Gaussian, not filled up."""
    weights: Float32Array
    """Sum of the Gaussian's weights over all pixels."""
    means_px: Float32Array
    """Derivatives by the projected means: all x, from `means_px[stride]` on all y."""
    stride: int
    pose: Float32Array
    """Derivatives by R_CW, row by row, and by the camera centre, in 16 parts each, shape (12 * 16,)."""


def allocate_aligned(count: int, dtype: npt.DTypeLike) -> AnyArray:
    """Uninitialised array that begins on a cache line."""
    size = count * np.dtype(dtype).itemsize
    raw = np.empty(size + 128, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(dtype)
