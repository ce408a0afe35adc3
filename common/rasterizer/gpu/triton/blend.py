# mypy: disable-error-code="no-untyped-def, no-untyped-call"
# Triton's compiler reads the annotations of a kernel: only `tl.constexpr` may stand there.
"""The Triton kernel that blends the sorted lists of tiles into images.

A program blends a tile, a pixel per lane. Front to back, with a transmittance T = 1 at first (`light` in the code):

    log2(alpha) = A dx^2 + B dx dy + C dy^2 + log2(opacity),   alpha at most 0.99, and 0 below 1/255
    weight = alpha T,   colour += weight * record's colour,   T -= weight,   finished once T < 1e-4.

Source: Kerbl et al., 3D Gaussian Splatting, 2023, section 6 and appendix C.
"""

import triton
import triton.language as tl

from readygo.common.rasterizer import constants
from readygo.common.rasterizer.gpu.triton import project
from readygo.common.rasterizer.gpu.triton.project import RECORD

COLOUR_PLANES = 4
"""Red, green, blue, transmittance."""
DEPTH_PLANES = 3
"""Weighted depth, depth and human of the median Gaussian."""
NORMAL_PLANES = 3

_RECORD = tl.constexpr(RECORD)
_COLOUR_PLANES = tl.constexpr(COLOUR_PLANES)
_DEPTH_PLANES = tl.constexpr(DEPTH_PLANES)
_ALPHA_MAX = tl.constexpr(constants.ALPHA_MAX)
_TRANSMITTANCE_MIN = tl.constexpr(constants.TRANSMITTANCE_MIN)
_LOG2_ALPHA_MIN = tl.constexpr(constants.LOG2_ALPHA_MIN)
_X, _Y = tl.constexpr(project.RECORD_X), tl.constexpr(project.RECORD_Y)
_A, _B, _C = tl.constexpr(project.RECORD_A), tl.constexpr(project.RECORD_B), tl.constexpr(project.RECORD_C)
_OPACITY, _DEPTH = tl.constexpr(project.RECORD_OPACITY), tl.constexpr(project.RECORD_DEPTH)
_RED, _GREEN = tl.constexpr(project.RECORD_RED), tl.constexpr(project.RECORD_GREEN)
_BLUE = tl.constexpr(project.RECORD_BLUE)
_RECORD_NORMAL = tl.constexpr(project.RECORD_NORMAL)
_LANE_BITS = tl.constexpr(project.LANE_BITS)
_SLOT_MASK = tl.constexpr(0xFFFFFFFF)
"""Bits of an entry that hold its slot."""
_BATCH = tl.constexpr(32)
"""Entries between two looks at whether all pixels are finished."""


@triton.jit(do_not_specialize=["entry_capacity"])
def blend(
    entries, spare, starts, counts, in_spare, entry_capacity, records, record_normals, owners, planes, alive,
    width, height, PLANES: tl.constexpr, DEPTH: tl.constexpr, NORMALS: tl.constexpr,
    TILE_W: tl.constexpr, TILE_H: tl.constexpr, COLUMNS: tl.constexpr, ROWS: tl.constexpr,
):  # fmt: skip
    """Blend each tile's list, nearest first, onto what its pixels hold; programs (B * T,).

    Args:
        entries: Lists, sorted by depth unless the sorted form is in `spare`, int64, shape (entry_capacity,).
        spare: Sorted form of the lists that `in_spare` names, int64, shape (entry_capacity,).
        starts: Where each list begins, shape (B * T,).
        counts: Entries of each list, shape (B * T,).
        in_spare: 1 for lists whose sorted form is in `spare`, int32, shape (B * T,).
        entry_capacity: Room for entries.
        records: Projected Gaussians by slot, shape (capacity * 256, RECORD).
        record_normals: With NORMALS: axes towards the camera, in its frame, shape (capacity * 256, 4).
        owners: Number of each pair's human, from 1; 0: the scene, shape (capacity,).
        planes: Read and written: the images as they are so far, shape (B, PLANES, H, W).
        alive: Read and written: 1 for tiles with an unfinished pixel, int32, shape (B * T,).
        width: Image width, W [px].
        height: Image height, H [px].
        PLANES: Planes per image: COLOUR_PLANES, then DEPTH_PLANES and NORMAL_PLANES if they are wanted.
        DEPTH: Blend depths.
        NORMALS: Blend normals.
        TILE_W: Tile width [px].
        TILE_H: Tile height [px].
        COLUMNS: Tiles along an image row.
        ROWS: Tiles along an image column.
    """
    tile = tl.program_id(0)
    start = tl.load(starts + tile)
    count = tl.minimum(tl.load(counts + tile), tl.maximum(entry_capacity - start, 0)).to(tl.int32)
    if count > 0:
        source = entries + start
        if tl.load(in_spare + tile) != 0:
            source = spare + start
        camera, local = tile // (COLUMNS * ROWS), tile % (COLUMNS * ROWS)
        row = (local // COLUMNS) * TILE_H + tl.arange(0, TILE_H)[:, None]
        column = (local % COLUMNS) * TILE_W + tl.arange(0, TILE_W)[None, :]
        inside = (row < height) & (column < width)
        size = height * width
        pixel = planes + camera.to(tl.int64) * (PLANES * size) + row * width + column
        x, y = column.to(tl.float32) + 0.5, row.to(tl.float32) + 0.5
        red, green = tl.load(pixel, mask=inside, other=0.0), tl.load(pixel + size, mask=inside, other=0.0)
        blue = tl.load(pixel + 2 * size, mask=inside, other=0.0)
        # Pixels outside of the image count as finished.
        light = tl.load(pixel + 3 * size, mask=inside, other=0.0)
        # Where the planes of depths and of normals begin.
        deep = pixel + _COLOUR_PLANES * size
        turned = deep
        if DEPTH:
            depth = tl.load(deep, mask=inside, other=0.0)
            median_depth = tl.load(deep + size, mask=inside, other=0.0)
            median_owner = tl.load(deep + 2 * size, mask=inside, other=0.0)
            turned = deep + _DEPTH_PLANES * size
        if NORMALS:
            normal_x = tl.load(turned, mask=inside, other=0.0)
            normal_y = tl.load(turned + size, mask=inside, other=0.0)
            normal_z = tl.load(turned + 2 * size, mask=inside, other=0.0)
        first = 0
        unfinished = 1
        while (first < count) & (unfinished != 0):
            for i in range(first, tl.minimum(first + _BATCH, count)):
                slot = tl.load(source + i) & _SLOT_MASK
                r = records + slot * _RECORD
                dx, dy = x - tl.load(r + _X), y - tl.load(r + _Y)
                a, b, c = tl.load(r + _A), tl.load(r + _B), tl.load(r + _C)
                t = dx * (dx * a + dy * b) + (dy * dy * c + tl.load(r + _OPACITY))
                alpha = tl.where(t >= _LOG2_ALPHA_MIN, tl.minimum(tl.exp2(t), _ALPHA_MAX), 0.0)
                weight = alpha * light
                red += weight * tl.load(r + _RED)
                green += weight * tl.load(r + _GREEN)
                blue += weight * tl.load(r + _BLUE)
                if DEPTH:
                    z = tl.load(r + _DEPTH)
                    # Not for finished pixels: a sky at 1.8 km would move even a weight of TRANSMITTANCE_MIN by 0.2 m.
                    depth += tl.where(light >= _TRANSMITTANCE_MIN, weight * z, 0.0)
                    # The Gaussian that takes the transmittance below one half.
                    median = (light >= 0.5) & (light - weight < 0.5)
                    median_depth = tl.where(median, z, median_depth)
                    median_owner = tl.where(median, tl.load(owners + (slot >> _LANE_BITS)).to(tl.float32), median_owner)
                if NORMALS:
                    n = record_normals + slot * _RECORD_NORMAL
                    normal_x += weight * tl.load(n)
                    normal_y += weight * tl.load(n + 1)
                    normal_z += weight * tl.load(n + 2)
                light = light - weight
            first += _BATCH
            unfinished = (tl.max(tl.max(light, axis=1), axis=0) >= _TRANSMITTANCE_MIN).to(tl.int32)
        tl.store(alive + tile, unfinished)
        tl.store(pixel, red, mask=inside)
        tl.store(pixel + size, green, mask=inside)
        tl.store(pixel + 2 * size, blue, mask=inside)
        tl.store(pixel + 3 * size, light, mask=inside)
        if DEPTH:
            tl.store(deep, depth, mask=inside)
            tl.store(deep + size, median_depth, mask=inside)
            tl.store(deep + 2 * size, median_owner, mask=inside)
        if NORMALS:
            tl.store(turned, normal_x, mask=inside)
            tl.store(turned + size, normal_y, mask=inside)
            tl.store(turned + 2 * size, normal_z, mask=inside)
