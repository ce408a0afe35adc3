"""What the CPU rasterizer makes of a view beside its colours: depth, alpha, whose a pixel is, normals."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Int16Array, UInt8Array
from readygo.common.images.images import Images
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.cpu.workspace import (
    BLOCK,
    BLOCK_BITS,
    BLOCK_STATE,
    RECORD,
    RECORD_DEPTH,
    RECORD_NORMAL,
    STATE_TRANSMITTANCE,
    TILE,
    TILE_BITS,
    Depths,
    Workspace,
)
from readygo.common.rasterizer.packed.scene import NORMAL_STEP
from readygo.common.simd.memory import load_short, store_f16
from readygo.common.simd.types import LANES, fma, where

_BLOCK_NORMALS = 3 * LANES
"""Numbers per block of packed normals and of sums of normals."""


class Sums(NamedTuple):
    """What is added up beside colours while an image is blended; None: not wanted, and not compiled in."""

    depths: Depths | None = None
    normals: Float32Array | None = None
    """Sums of normals: per tile 16 blocks of x, y, z of 4x4 px, shape (T * 768,)."""

    def clear(self) -> None:
        """Set all sums to zero before an image."""
        if self.depths is not None:
            self.depths.weighted_m.fill(0.0)
        if self.normals is not None:
            self.normals.fill(0.0)


@inline_kernel
def normal_block(normal: Int16Array | None, block: int, x: Any, y: Any, z: Any, R: Any, ws: Workspace) -> None:
    """Write a block's normals, turned towards the camera, to the rows of the scratch memory that become records.

    Args:
        normal: Packed normals, flat; None: nothing is written.
        block: Number of the block.
        x: Camera coordinates x of the means [m].
        y: Camera coordinates y of the means [m].
        z: Camera coordinates z of the means [m].
        R: Rotation from the frame of the covariances to the camera, row by row, nine values.
        ws: Workspace.
    """
    if normal is not None:
        o = block * _BLOCK_NORMALS
        px, py, pz = load_short(normal, o), load_short(normal, o + LANES), load_short(normal, o + 2 * LANES)
        nx = fma(R[0], px, fma(R[1], py, R[2] * pz))
        ny = fma(R[3], px, fma(R[4], py, R[5] * pz))
        nz = fma(R[6], px, fma(R[7], py, R[8] * pz))
        # Of both directions the one whose product with the ray to the mean (x, y, z) is negative.
        step = where(fma(x, nx, fma(y, ny, z * nz)) > 0.0, -NORMAL_STEP, NORMAL_STEP)
        store_f16(ws.scratch, LANES * RECORD_NORMAL, nx * step)
        store_f16(ws.scratch, LANES * (RECORD_NORMAL + 1), ny * step)
        store_f16(ws.scratch, LANES * (RECORD_NORMAL + 2), nz * step)


def instance_of_records(ends: Sequence[int], ids: Sequence[int]) -> UInt8Array:
    """Whose each record is.

    Args:
        ends: Number of records after each layer's turn; the layers take turns in the same order.
        ids: Number of each layer's human, 0 for the scene.

    Returns:
        Shape (R,).
    """
    turns = np.tile(np.array(ids, dtype=np.uint8), len(ends) // max(len(ids), 1))
    edges = np.array([0, *ends], dtype=np.int64)
    return np.repeat(turns, edges[1:] - edges[:-1])


def write_images(
    wanted: frozenset[str],
    images: Images,
    ws: Workspace,
    sums: Sums,
    instances: UInt8Array | None,
) -> None:
    """Write the images besides rgb of the view that was blended last.

    Args:
        wanted: Names of the images.
        images: Memory for them.
        ws: Workspace.
        sums: What was added up.
        instances: Whose each record is; needed for the mask.
    """
    width = images.rgb.shape[1]
    if "alpha" in wanted:
        write_alpha(width, ws, images.alpha)
    if "depth" in wanted:
        write_depth(width, ws, sums.depths, images.depth_m)
    if "median_depth" in wanted:
        write_median_depth(width, ws, sums.depths, images.median_depth_m)
    if "mask" in wanted:
        write_mask(width, ws, sums.depths, instances, images.mask)
    if "normal" in wanted:
        write_normal(width, sums.normals, images.normal)


@inline_kernel
def _place(width: int, u: int, v: int) -> int:
    """Index of a pixel in memory that holds one value per pixel: tile by tile, block by block, row by row."""
    tile = (v >> TILE_BITS) * ((width + TILE - 1) >> TILE_BITS) + (u >> TILE_BITS)
    block = ((v >> BLOCK_BITS) & 3) * 4 + ((u >> BLOCK_BITS) & 3)
    return tile * (TILE * TILE) + block * LANES + (v & (BLOCK - 1)) * BLOCK + (u & (BLOCK - 1))


@inline_kernel
def _transmittance(ws: Workspace, place: int) -> Any:
    """Transmittance of the pixel with an index of `_place`: block place / 16, pixel place mod 16 of it."""
    return ws.tile_state[(place >> 4) * BLOCK_STATE + STATE_TRANSMITTANCE + (place & 15)]


@kernel
def write_alpha(width: int, ws: Workspace, alpha: Float32Array) -> None:
    """Write opacities, shape (H, W)."""
    for v in range(alpha.shape[0]):
        for u in range(width):
            alpha[v, u] = np.float32(1.0) - _transmittance(ws, _place(width, u, v))


@kernel
def write_depth(width: int, ws: Workspace, depths: Depths, depth_m: Float32Array) -> None:
    """Write mean depths [m], shape (H, W)."""
    for v in range(depth_m.shape[0]):
        for u in range(width):
            place = _place(width, u, v)
            alpha = np.float32(1.0) - _transmittance(ws, place)
            depth_m[v, u] = depths.weighted_m[place] / alpha if alpha > 0.0 else np.float32(np.inf)


@kernel
def write_median_depth(width: int, ws: Workspace, depths: Depths, depth_m: Float32Array) -> None:
    """Write depths of the median Gaussians [m], shape (H, W)."""
    for v in range(depth_m.shape[0]):
        for u in range(width):
            place = _place(width, u, v)
            found = _transmittance(ws, place) < 0.5
            record = np.int64(depths.median[place]) if found else 0
            depth_m[v, u] = ws.records[record * RECORD + RECORD_DEPTH] if found else np.float32(np.inf)


@kernel
def write_mask(width: int, ws: Workspace, depths: Depths, instances: UInt8Array, mask: UInt8Array) -> None:
    """Write whose the median Gaussians are, shape (H, W)."""
    for v in range(mask.shape[0]):
        for u in range(width):
            place = _place(width, u, v)
            mask[v, u] = instances[depths.median[place]] if _transmittance(ws, place) < 0.5 else np.uint8(0)


@kernel
def write_normal(width: int, normals: Float32Array, normal: Float32Array) -> None:
    """Write mean normals of length 1, shape (H, W, 3)."""
    for v in range(normal.shape[0]):
        for u in range(width):
            place = _place(width, u, v)
            first = (place >> 4) * _BLOCK_NORMALS + (place & 15)
            x, y, z = normals[first], normals[first + LANES], normals[first + 2 * LANES]
            length = math.sqrt(x * x + y * y + z * z)
            scale = np.float32(1.0) / length if length > 0.0 else np.float32(0.0)
            normal[v, u, 0], normal[v, u, 1], normal[v, u, 2] = x * scale, y * scale, z * scale
