"""Walls, ceilings, floors, doorways and windows of the flat."""

from dataclasses import replace

import numpy as np

from readygo.common.scenes.embedded.plan import (
    CEILING_M,
    OUTER_WALL_M,
    Finish,
    FloorPlan,
    Opening,
    Room,
    Wall,
    pieces,
)
from readygo.common.scenes.embedded.surfaces import Surfaces, Vector
from readygo.common.scenes.embedded.textures import Texture, plain, stripes, wood

_WHITE = (0.93, 0.92, 0.89)
_CORE_Z_M = 0.4
_CORE_COLOUR = (0.45, 0.45, 0.46)
_WALL_CELL_M = 0.15
_TRIM_M = 0.02


def build_shell(build: Surfaces, plan: FloorPlan) -> None:
    """Everything that does not stand on the floor by itself."""
    _solids(build, plan)
    for room in plan.rooms:
        for side in room.walls:
            _wall_face(build, plan, room, side)
        _ceiling(build, room)
    for opening in plan.openings:
        wall = plan.walls[opening.wall]
        _reveal(build, wall, opening)
        (_window_frame if opening.is_window else _door_casing)(build, wall, opening)
    _wall_cores(build, plan)


def facing_wall(build: Surfaces, room: Room, side: str) -> tuple[Surfaces, float]:
    """A placement on a wall: x to the right along it from its left corner, y into it, z up; and its length [m]."""
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    if side == "north":
        return build.at(x0, y1), x1 - x0
    if side == "south":
        return build.at(x1, y0, yaw_deg=180), x1 - x0
    if side == "west":
        return build.at(x0, y0, yaw_deg=90), y1 - y0
    return build.at(x1, y1, yaw_deg=-90), y1 - y0


def along_wall(room: Room, side: str, opening: Opening) -> tuple[float, float]:
    """Begin and end of an opening, measured from the left corner of a room's wall [m]."""
    start = {"north": room.x_m[0], "south": room.x_m[1], "west": room.y_m[0], "east": room.y_m[1]}[side]
    if side in ("north", "west"):
        return opening.begin_m - start, opening.end_m - start
    return start - opening.end_m, start - opening.begin_m


def local_openings(plan: FloorPlan, room: Room, side: str) -> list[Opening]:
    """The openings of a room's wall, measured from its left corner and sorted along it."""
    length = room.x_m[1] - room.x_m[0] if side in ("north", "south") else room.y_m[1] - room.y_m[0]
    local = []
    for opening in plan.openings_of(room.walls[side]):
        begin, end = along_wall(room, side, opening)
        if end > 0 and begin < length:
            local.append(replace(opening, begin_m=begin, end_m=end))
    return sorted(local, key=lambda cut: cut.begin_m)


def _wall_face(build: Surfaces, plan: FloorPlan, room: Room, side: str) -> None:
    wall, length = facing_wall(build, room, side)
    local = local_openings(plan, room, side)
    paint, finish = _paint(room, side), _finish(room, side)
    for begin, end, bottom, top in pieces(0.0, length, local):
        if bottom == 0.0:
            bottom = 0.93 if room.panelled and top > 0.95 else 0.08
        if finish is Finish.BRICKS:
            _bricks(wall, begin, end, bottom, top)
            continue
        if top - bottom < 0.02:
            continue
        texture = _shift_texture(paint, begin, bottom)
        cell = (0.06, 0.2) if finish is Finish.STRIPES else _WALL_CELL_M
        wall.patch(
            (begin, 0, bottom), (end - begin, 0, 0), (0, 0, top - bottom), cell, texture, jitter=0.3, softness=0.74
        )
    doors = [cut for cut in local if not cut.is_window]
    for begin, end, bottom, _ in pieces(0.0, length, doors):
        if bottom == 0.0:
            _skirting(wall, begin, end)
            if room.panelled:
                _panelling(wall, begin, end, [cut for cut in local if cut.is_window])


def _finish(room: Room, side: str) -> Finish:
    covering = room.coverings.get(side)
    return Finish.PAINT if covering is None else covering.finish


def _paint(room: Room, side: str) -> Texture:
    seed, covering = len(room.name) * 10 + len(side), room.coverings.get(side)
    if covering is None or covering.finish is Finish.BRICKS:
        return plain(room.paint, variation=0.05, seed=seed)
    if covering.finish is Finish.STRIPES:
        first, second = covering.colours
        return stripes(first, second, 0.12, seed=seed)
    return plain(covering.colours[0], variation=0.05, seed=seed)


def _shift_texture(texture: Texture, begin: float, bottom: float) -> Texture:
    # Neighbouring pieces of one wall share one pattern.
    return lambda u, v: texture(u + begin, v + bottom)


def _bricks(wall: Surfaces, begin: float, end: float, bottom: float, top: float) -> None:
    right_way, out = np.array([1.0, 0, 0]), np.array([0, -1.0, 0])
    mortar = np.array([0.72, 0.68, 0.62])
    width, height = 0.25, 0.085
    for row in range(int(bottom / height), int(np.ceil(top / height))):
        shift = 0.5 * width * (row % 2)
        columns = np.arange(np.floor((begin - shift) / width), np.ceil((end - shift) / width))
        left = np.maximum(columns * width + shift, begin)
        right = np.minimum((columns + 1) * width + shift, end)
        low, high = max(row * height, bottom), min((row + 1) * height, top)
        keep = right - left > 0.05
        if high - low < 0.03 or not keep.any():
            continue
        centre, size = (left + right)[keep] / 2, (right - left)[keep] - 0.016
        tone = 0.82 + 0.36 * wall.rng.random(len(centre))
        for part in (-0.25, 0.25):
            position = np.column_stack(
                [centre + part * size, np.zeros(len(centre)), np.full(len(centre), (low + high) / 2)]
            )
            sigma = np.column_stack(
                [size * 0.30, np.full(len(centre), (high - low - 0.014) * 0.48), np.full(len(centre), 0.004)]
            )
            colour = np.array([0.70, 0.40, 0.30]) * tone[:, None]
            wall.add(position, right_way, out, sigma, colour)
        bed = np.column_stack([centre, np.full(len(centre), 0.001), np.full(len(centre), low)])
        wall.add(bed, right_way, out, np.column_stack([size * 0.6, np.full((len(centre), 2), 0.006)]), mortar)
        joint = np.column_stack([left[keep], np.full(len(centre), 0.001), np.full(len(centre), (low + high) / 2)])
        wall.add(joint, np.array([0, 0, 1.0]), out, [(high - low) * 0.5, 0.006, 0.006], mortar)


def _skirting(wall: Surfaces, begin: float, end: float) -> None:
    wall.patch((begin, -0.015, 0), (end - begin, 0, 0), (0, 0, 0.09), (0.2, 0.045), _WHITE)
    wall.patch((begin, -0.015, 0.09), (end - begin, 0, 0), (0, 0.015, 0), (0.2, 0.02), _WHITE)


def _panelling(wall: Surfaces, begin: float, end: float, windows: list[Opening]) -> None:
    """Wooden panels up to 0.95 m with a rail on top."""
    for left, right, bottom, top in pieces(begin, end, windows):
        if bottom > 0 or top < 0.95 or right - left < 0.05:
            continue
        wall.patch((left, -0.01, 0.09), (right - left, 0, 0), (0, 0, 0.83), (0.12, 0.14), plain((0.88, 0.88, 0.85)))
        wall.patch((left, -0.03, 0.90), (right - left, 0, 0), (0, 0, 0.05), (0.2, 0.05), _WHITE)
        wall.patch((left, -0.03, 0.95), (right - left, 0, 0), (0, 0.03, 0), (0.2, 0.03), _WHITE)
        count = max(1, round((right - left) / 0.42))
        for k in range(count):
            a = left + (right - left) * (k + 0.5) / count
            half = 0.5 * (right - left) / count - 0.06
            for x in (a - half, a + half):
                wall.patch((x - 0.008, -0.013, 0.17), (0.016, 0, 0), (0, 0, 0.66), (0.016, 0.17), (0.62, 0.63, 0.62))
            for z in (0.17, 0.83):
                wall.patch(
                    (a - half, -0.013, z - 0.008), (2 * half, 0, 0), (0, 0, 0.016), (0.12, 0.016), (0.62, 0.63, 0.62)
                )


def _ceiling(build: Surfaces, room: Room) -> None:
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    build.patch(
        (x0, y1, CEILING_M),
        (x1 - x0, 0, 0),
        (0, y0 - y1, 0),
        0.25,
        plain((0.95, 0.94, 0.92)),
        jitter=0.3,
        softness=0.74,
    )


def _box_of(wall: Wall, begin: float, end: float, bottom: float, top: float) -> tuple[Vector, Vector]:
    if wall.axis == "y":
        return (begin, wall.low_m, bottom), (end, wall.high_m, top)
    return (wall.low_m, begin, bottom), (wall.high_m, end, top)


def _solids(build: Surfaces, plan: FloorPlan) -> None:
    for name, wall in plan.walls.items():
        for begin, end, bottom, top in pieces(wall.begin_m, wall.end_m, plan.openings_of(name)):
            build.solid(*_box_of(wall, begin, end, bottom, top))
    (west, south), (east, north), edge = plan.low_m, plan.high_m, OUTER_WALL_M
    build.solid((west - edge, south - edge, -0.05), (east + edge, north + edge, 0.0))
    build.solid((west - edge, south - edge, CEILING_M), (east + edge, north + edge, CEILING_M + 0.05))


def _through(build: Surfaces, wall: Wall, opening: Opening) -> tuple[Surfaces, float, float]:
    """A placement at an opening's left jamb seen from its low side: x along it, y through the wall; width, depth."""
    width, depth = opening.end_m - opening.begin_m, wall.high_m - wall.low_m
    if wall.axis == "y":
        return build.at(opening.begin_m, wall.low_m), width, depth
    return build.at(wall.low_m, opening.end_m, yaw_deg=-90), width, depth


def _reveal(build: Surfaces, wall: Wall, opening: Opening) -> None:
    """The four inner faces of an opening."""
    part, width, depth = _through(build, wall, opening)
    low, high = opening.bottom_m, opening.top_m
    tall = (0.0, 0.0, high - low)
    part.patch((0, 0, low), (0, depth, 0), tall, (0.07, 0.15), _WHITE)
    part.patch((width, depth, low), (0, -depth, 0), tall, (0.07, 0.15), _WHITE)
    part.patch((0, depth, high), (width, 0, 0), (0, -depth, 0), (0.15, 0.07), _WHITE)
    if opening.is_window:
        part.patch((0, 0, low), (width, 0, 0), (0, depth, 0), (0.12, 0.07), _WHITE)


def _door_casing(build: Surfaces, wall: Wall, opening: Opening) -> None:
    part, width, depth = _through(build, wall, opening)
    brown = wood((0.90, 0.89, 0.86), along_u=False, contrast=0.06)
    for y0, y1, face in ((-_TRIM_M, 0.0, "front"), (depth, depth + _TRIM_M, "back")):
        for x0, x1 in ((-0.08, 0.0), (width, width + 0.08)):
            part.box(
                (x0, y0, 0), (x1, y1, opening.top_m), (0.04, 0.15), brown, faces=(face, "left", "right"), solid=False
            )
        part.box(
            (-0.08, y0, opening.top_m),
            (width + 0.08, y1, opening.top_m + 0.08),
            (0.15, 0.04),
            brown,
            faces=(face, "top", "bottom"),
            solid=False,
        )
    part.patch((0, 0, 0.004), (width, 0, 0), (0, depth, 0), (0.15, 0.05), wood((0.50, 0.36, 0.23)))


def _window_frame(build: Surfaces, wall: Wall, opening: Opening) -> None:
    part, width, depth = _through(build, wall, opening)
    low, high = opening.bottom_m, opening.top_m
    outer_low = opening.wall in ("west", "south")
    y0, y1 = (0.04, 0.09) if outer_low else (depth - 0.09, depth - 0.04)
    bars = [(0.0, 0.06, low, high), (width - 0.06, width, low, high), (0.0, width, low, low + 0.06)]
    bars += [(0.0, width, high - 0.06, high), (width / 2 - 0.03, width / 2 + 0.03, low, high)]
    for x0, x1, z0, z1 in bars:
        cell = (0.06, 0.2) if z1 - z0 > x1 - x0 else (0.2, 0.06)
        part.box((x0, y0, z0), (x1, y1, z1), cell, _WHITE)
    inner = depth if outer_low else -0.07
    part.box((-0.05, inner, low - 0.03), (width + 0.05, inner + 0.07, low), (0.12, 0.04), _WHITE, solid=False)


def _wall_cores(build: Surfaces, plan: FloorPlan) -> None:
    """A dark layer inside the walls, hidden from the rooms: it fills the walls in maps and in views from above."""
    for name, wall in plan.walls.items():
        for begin, end, bottom, top in pieces(wall.begin_m, wall.end_m, plan.openings_of(name)):
            if bottom < _CORE_Z_M < top:
                count = max(1, round((end - begin) / 0.1))
                step = (end - begin) / count
                along, across = begin + (np.arange(count) + 0.5) * step, (wall.low_m + wall.high_m) / 2
                ends = (along, np.full(count, across))
                x, y = ends if wall.axis == "y" else ends[::-1]
                tangent = np.array([1.0, 0, 0]) if wall.axis == "y" else np.array([0, 1.0, 0])
                sigma = [step * 0.55, (wall.high_m - wall.low_m) * 0.2, 0.004]
                position = np.column_stack([x, y, np.full(count, _CORE_Z_M)])
                build.add(position, tangent, np.array([0, 0, 1.0]), sigma, _CORE_COLOUR)
