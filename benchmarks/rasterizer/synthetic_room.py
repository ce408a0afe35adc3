"""A furnished flat of any number of Gaussians, made by code from a seed, so that anyone can repeat a speed figure.

Six rooms with furniture. Its Gaussians are like those of a trained indoor scene: mostly flat, lying in the surfaces,
1 to 4 cm across at 500,000 and smaller as their number grows; some fuzzy ones float beside the surfaces; opacities have
one peak at 1 and a long tail; colours depend on the direction.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.gaussians import GaussianCloud, sh_of_rgb
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap

SIZE_M = (12.0, 9.0, 2.7)
ROOMS = (3, 2)
DOOR_M = (0.95, 2.1)
"""Width and height of the openings between neighbouring rooms."""
DOORLESS = ((1, 1, 0), (1, 1, 2))
"""Walls without an opening: axis, line and cell. The rooms form one corridor, so that most of the flat is hidden."""
FURNITURE_PER_ROOM = 6
COEFFICIENTS = 16
FUZZY_SHARE = 0.12
BLOCK = 1 << 17
"""Gaussians that are drawn from one random stream, so that memory is bounded."""
CELL_M = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class RoomBox:
    """A box that stands in the flat [m]."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianSheet:
    """A rectangle that is covered with Gaussians."""

    corner_m: Float64Array
    sides_m: Float64Array
    """Two edges at right angles from the corner, along the axes, shape (2, 3)."""
    rgb: tuple[float, float, float]
    pattern_m: float
    """Wave length of its texture."""

    @property
    def area_m2(self) -> float:
        """Its area."""
        return float(np.abs(self.sides_m[0]).sum() * np.abs(self.sides_m[1]).sum())


def room_cloud(count: int, seed: int = 0) -> GaussianCloud:
    """All Gaussians of the flat in one cloud; see `room_pieces`."""
    cloud = GaussianCloud(
        means_m=np.empty((count, 3), dtype=np.float32),
        quats_wxyz=np.empty((count, 4), dtype=np.float32),
        scales_m=np.empty((count, 3), dtype=np.float32),
        opacities=np.empty(count, dtype=np.float32),
        sh=np.empty((count, COEFFICIENTS, 3), dtype=np.float32),
    )
    first = 0
    for piece in room_pieces(count, seed):
        rows = slice(first, first + len(piece))
        for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh"):
            getattr(cloud, name)[rows] = getattr(piece, name)
        first += len(piece)
    return cloud


def room_pieces(count: int, seed: int = 0) -> Iterator[GaussianCloud]:
    """The flat piece by piece, at most `BLOCK` Gaussians at a time.

    Args:
        count: Gaussians in all pieces together, at least one per surface (some 250).
        seed: Seed of furniture and Gaussians.

    Raises:
        ValueError: If `count` is too small.
    """
    sheets = _sheets(seed)
    if count < len(sheets):
        raise ValueError(f"a synthetic room needs at least {len(sheets)} Gaussians, got {count}.")
    areas = np.array([sheet.area_m2 for sheet in sheets])
    ends = np.rint(np.cumsum(areas) / areas.sum() * count).astype(np.int64)
    spacing_m = math.sqrt(float(areas.sum()) / count)
    for number, (sheet, size) in enumerate(zip(sheets, np.diff(ends, prepend=0).tolist(), strict=True)):
        for block in range(-(-size // BLOCK)):
            rng = np.random.Generator(np.random.Philox(key=[seed, number * 65536 + block]))
            yield _cover(sheet, min(BLOCK, size - block * BLOCK), spacing_m, rng)


def room_maps(seed: int = 0, clearance_height_m: float = 1.9) -> tuple[OccupancyMap, FloorMap]:
    """What stands in the way below a height, and the floor (flat, at 0)."""
    shape = tuple(round(size / CELL_M) for size in (SIZE_M[1], SIZE_M[0]))
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=CELL_M)
    occupied = np.zeros(shape, dtype=np.bool_)
    for box in (*_walls(), *_furniture(seed)):
        if box.low_m[2] < clearance_height_m:
            x0, y0 = (math.floor(box.low_m[k] / CELL_M) for k in (0, 1))
            x1, y1 = (math.ceil(box.high_m[k] / CELL_M) for k in (0, 1))
            occupied[max(y0, 0) : y1 + 1, max(x0, 0) : x1 + 1] = True
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    floor = FloorMap(frame=frame, height_m=np.zeros(shape, dtype=np.float32))
    return OccupancyMap(frame=frame, occupied=occupied), floor


def _walls() -> list[RoomBox]:
    """Inner walls: either side of every door, and the lintel above it."""
    boxes: list[RoomBox] = []
    parts: tuple[tuple[float, float, float], ...]
    thickness = 0.12
    width, height = DOOR_M
    room = SIZE_M[0] / ROOMS[0], SIZE_M[1] / ROOMS[1]
    for axis in (0, 1):
        across = 1 - axis
        for line in range(1, ROOMS[axis]):
            at = line * room[axis]
            for cell in range(ROOMS[across]):
                begin, end = cell * room[across], (cell + 1) * room[across]
                left, right = 0.5 * (begin + end - width), 0.5 * (begin + end + width)
                parts = ((begin, left, 0.0), (right, end, 0.0), (left, right, height))
                if (axis, line, cell) in DOORLESS:
                    parts = ((begin, end, 0.0),)
                for first, last, bottom in parts:
                    low, high = [0.0, 0.0, bottom], [0.0, 0.0, SIZE_M[2]]
                    low[axis], high[axis] = at - 0.5 * thickness, at + 0.5 * thickness
                    low[across], high[across] = first, last
                    boxes.append(RoomBox(low_m=(low[0], low[1], low[2]), high_m=(high[0], high[1], high[2])))
    return boxes


def _furniture(seed: int) -> list[RoomBox]:
    """Boxes of the sizes of sofas, tables and shelves along the rooms' walls, off the doors."""
    rng = np.random.Generator(np.random.Philox(key=[seed, 1 << 62]))
    room = SIZE_M[0] / ROOMS[0], SIZE_M[1] / ROOMS[1]
    boxes = []
    for cell in range(ROOMS[0] * ROOMS[1]):
        origin = (cell % ROOMS[0]) * room[0], (cell // ROOMS[0]) * room[1]
        for piece in range(FURNITURE_PER_ROOM):
            side, half = piece % 4, (piece // 4) % 2
            axis = side % 2
            length = rng.uniform(0.5, 1.25)
            depth, height = rng.uniform(0.35, 0.8), rng.uniform(0.4, 2.1)
            # Half of a wall less half of a door is left for a piece.
            room_left = 0.5 * (room[axis] - DOOR_M[0]) - length - 0.15
            along = 0.1 + rng.uniform(0.0, max(room_left, 0.0)) + half * 0.5 * (room[axis] + DOOR_M[0])
            far = room[1 - axis] - 0.07 - depth
            low = [0.0, 0.0, 0.0]
            low[axis] = origin[axis] + along
            low[1 - axis] = origin[1 - axis] + (0.07 if side < 2 else far)
            size = [0.0, 0.0, height]
            size[axis], size[1 - axis] = length, depth
            boxes.append(
                RoomBox(
                    low_m=(low[0], low[1], 0.0),
                    high_m=(low[0] + size[0], low[1] + size[1], height),
                )
            )
    return boxes


def _sheets(seed: int) -> list[GaussianSheet]:
    """Floor, ceiling, outer walls, and the visible sides of all boxes."""
    rng = np.random.Generator(np.random.Philox(key=[seed, 1 << 61]))
    hull = RoomBox(low_m=(0.0, 0.0, 0.0), high_m=SIZE_M)
    sheets = _sides(hull, rng, (0, 1, 2, 3, 4, 5), pale=True)
    for box in _walls():
        sheets += _sides(box, rng, (0, 1, 2, 3, 4) if box.low_m[2] else (0, 1, 2, 3), pale=True)
    for box in _furniture(seed):
        sheets += _sides(box, rng, (0, 1, 2, 3, 5), pale=False)
    return sheets


def _sides(box: RoomBox, rng: np.random.Generator, sides: tuple[int, ...], *, pale: bool) -> list[GaussianSheet]:
    """Sides of a box: 2 k is the lower one along axis k / 2, 2 k + 1 the upper one."""
    low, high = np.array(box.low_m), np.array(box.high_m)
    tone = rng.uniform(0.55, 0.9) if pale else rng.uniform(0.2, 0.7)
    sheets = []
    for side in sides:
        axis = side // 2
        corner = low.copy()
        corner[axis] = (low, high)[side % 2][axis]
        edges = np.zeros((2, 3))
        for row, k in enumerate(sorted({0, 1, 2} - {axis})):
            edges[row, k] = high[k] - low[k]
        rgb = np.clip(tone + rng.uniform(-0.08, 0.08, 3), 0.02, 0.98)
        sheets.append(
            GaussianSheet(
                corner_m=corner,
                sides_m=edges,
                rgb=(float(rgb[0]), float(rgb[1]), float(rgb[2])),
                pattern_m=float(rng.uniform(0.1, 0.6)),
            )
        )
    return sheets


def _cover(sheet: GaussianSheet, count: int, spacing_m: float, rng: np.random.Generator) -> GaussianCloud:
    """Gaussians spread over a sheet."""
    at = rng.random((count, 2))
    fuzzy = rng.random(count) < FUZZY_SHARE
    thin = int(np.flatnonzero(np.abs(sheet.sides_m).sum(axis=0) == 0)[0])
    means = sheet.corner_m + at @ sheet.sides_m
    scales = spacing_m * 0.75 * np.exp(0.4 * rng.standard_normal((count, 3)))
    scales[~fuzzy, thin] *= 0.08
    means[:, thin] += np.where(fuzzy, 1.2, 0.05) * spacing_m * rng.standard_normal(count)
    opacities = np.where(rng.random(count) < 0.65, rng.beta(6.0, 0.8, count), rng.beta(0.8, 1.6, count))
    opacities[fuzzy] *= 0.4
    half_turn = rng.uniform(0.0, math.pi, count)
    quats = np.zeros((count, 4))
    # Turned about the sheet's normal only, so that the flat side stays in the surface.
    quats[:, 0], quats[:, 1 + thin] = np.cos(half_turn), np.sin(half_turn)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=quats.astype(np.float32),
        scales_m=scales.astype(np.float32),
        opacities=np.clip(opacities, 0.0, 1.0).astype(np.float32),
        sh=_colours(sheet, means, rng),
    )


def _colours(sheet: GaussianSheet, means_m: Float64Array, rng: np.random.Generator) -> Float32Array:
    """Spherical harmonics: a wavy texture, grain, and a little shine that depends on the direction."""
    wave = np.sin(means_m * (2.0 * math.pi / sheet.pattern_m)).sum(axis=1)
    grain = 0.04 * rng.standard_normal((len(means_m), 3))
    rgb = np.array(sheet.rgb) * (1.0 + 0.08 * wave)[:, None] + grain
    sh = rng.standard_normal((len(means_m), COEFFICIENTS, 3), dtype=np.float32)
    for band, spread in ((1, 0.04), (2, 0.02), (3, 0.015)):
        sh[:, band * band : (band + 1) ** 2] *= np.float32(spread)
    sh[:, 0] = sh_of_rgb(rgb)
    return sh
