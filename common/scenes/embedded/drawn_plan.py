"""Floor plans that are drawn: a rectangle that walls divide again and again, with doorways between the rooms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from readygo.common.scenes.embedded.plan import (
    CEILING_LAMP_M,
    OUTER_WALL_M,
    Covering,
    Finish,
    FloorPlan,
    Opening,
    Room,
    Wall,
)
from readygo.common.scenes.embedded.textures import Colour

WIDTH_M, DEPTH_M = (8.4, 10.4), (7.6, 9.6)
"""Sizes of flats, between the outer walls."""
ROOM_MIN_M = 2.6
"""Least side of a room that is no hall."""
ROOM_AREA_M2 = (13.0, 28.0)
"""Rooms larger than an area between these are divided."""
HALL_M = (1.6, 2.0)
"""Widths of halls, from wall to wall."""
HALL_SHARE = 0.6
"""Share of the flats that have a hall."""
DOOR_M = (1.1, 1.9)
DOOR_MARGIN_M = 0.1
"""Least distance of a doorway from a corner of its rooms."""
MORE_DOORS = 0.4
"""Probability of a doorway between two rooms that need none."""
WINDOW_M = (0.9, 1.7)
WINDOW_MARGIN_M = 0.45
WINDOW_SHARE = 0.85
"""Share of the outer walls of rooms that have windows."""
COVERED_SHARE = 0.6
"""Share of the rooms with one wall of another finish."""
LAMP_EVERY_M = 4.2
"""A room has a lamp for each begun stretch of this length."""
_WALL_M = 0.1
_PAINTS: tuple[Colour, ...] = (
    (0.90, 0.87, 0.80),
    (0.93, 0.91, 0.86),
    (0.80, 0.85, 0.87),
    (0.78, 0.83, 0.88),
    (0.89, 0.84, 0.76),
    (0.84, 0.88, 0.80),
    (0.92, 0.82, 0.78),
    (0.86, 0.86, 0.86),
)
_STRONG_PAINTS: tuple[Colour, ...] = (
    (0.50, 0.60, 0.53),
    (0.88, 0.72, 0.45),
    (0.42, 0.52, 0.62),
    (0.66, 0.42, 0.36),
    (0.60, 0.56, 0.68),
)
_FLOORS = ("oak", "walnut", "tiles", "carpet")


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A rectangle between four walls, which may be divided."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    walls: dict[str, str]
    is_hall: bool = False

    @property
    def sides_m(self) -> tuple[float, float]:
        return self.x_m[1] - self.x_m[0], self.y_m[1] - self.y_m[0]


def draw_plan(rng: np.random.Generator) -> FloorPlan:
    """A flat of about four to nine rooms, each of which can be reached; all lengths are exact to a centimetre."""
    width, depth = _length(rng, *WIDTH_M), _length(rng, *DEPTH_M)
    walls = _outer_walls(width, depth)
    whole = _Part(
        x_m=(walls["west"].high_m, walls["east"].low_m),
        y_m=(walls["south"].high_m, walls["north"].low_m),
        walls={side: side for side in walls},
    )
    parts = [whole]
    if rng.random() < HALL_SHARE:
        parts = _with_hall(whole, walls, rng)
    rooms = [room for part in parts for room in _divided(part, walls, rng, rng.uniform(*ROOM_AREA_M2))]
    openings = (*_doors(rooms, rng), *_windows(rooms, rng))
    finished = tuple(_finished(f"room {k}", room, rng) for k, room in enumerate(rooms))
    lamps = tuple(lamp for room in rooms for lamp in _lamps(room))
    return FloorPlan(walls=walls, openings=openings, rooms=finished, lamps_m=lamps)


def _length(rng: np.random.Generator, low_m: float, high_m: float) -> float:
    return round(float(rng.uniform(low_m, high_m)), 2)


def _outer_walls(width: float, depth: float) -> dict[str, Wall]:
    x, y, edge = round(width / 2, 2), round(depth / 2, 2), OUTER_WALL_M
    return {
        "west": Wall(axis="x", low_m=-x - edge, high_m=-x, begin_m=-y - edge, end_m=y + edge),
        "east": Wall(axis="x", low_m=x, high_m=x + edge, begin_m=-y - edge, end_m=y + edge),
        "south": Wall(axis="y", low_m=-y - edge, high_m=-y, begin_m=-x, end_m=x),
        "north": Wall(axis="y", low_m=y, high_m=y + edge, begin_m=-x, end_m=x),
    }


def _with_hall(whole: _Part, walls: dict[str, Wall], rng: np.random.Generator) -> list[_Part]:
    """A hall across the whole flat, and what lies on both sides of it."""
    across = int(rng.integers(2))
    width, length = _length(rng, *HALL_M), whole.sides_m[across]
    room = length - width - 2 * _WALL_M
    before, rest = _split(whole, across, round(float(rng.uniform(ROOM_MIN_M, room - ROOM_MIN_M)), 2), walls)
    hall, behind = _split(rest, across, width, walls)
    return [before, replace(hall, is_hall=True), behind]


def _divided(part: _Part, walls: dict[str, Wall], rng: np.random.Generator, area_max_m2: float) -> list[_Part]:
    """A part, or its halves, divided in turn."""
    sides = part.sides_m
    longer = int(np.argmax(sides))
    spare = sides[longer] - _WALL_M - 2 * ROOM_MIN_M
    if part.is_hall or spare < 0 or sides[0] * sides[1] < area_max_m2:
        return [part]
    first, second = _split(part, longer, round(ROOM_MIN_M + spare * float(rng.uniform(0.1, 0.9)), 2), walls)
    return [room for half in (first, second) for room in _divided(half, walls, rng, area_max_m2)]


def _split(part: _Part, across: int, at_m: float, walls: dict[str, Wall]) -> tuple[_Part, _Part]:
    """Cut a part with a new wall after `at_m` along x (0) or y (1)."""
    (low, high), (begin, end) = (part.x_m, part.y_m) if across == 0 else (part.y_m, part.x_m)
    name, before, after = f"inner {len(walls)}", round(low + at_m, 2), round(low + at_m + _WALL_M, 2)
    walls[name] = Wall(axis="xy"[across], low_m=before, high_m=after, begin_m=begin, end_m=end)
    if across == 0:
        return (
            replace(part, x_m=(low, before), walls=part.walls | {"east": name}),
            replace(part, x_m=(after, high), walls=part.walls | {"west": name}),
        )
    return (
        replace(part, y_m=(low, before), walls=part.walls | {"north": name}),
        replace(part, y_m=(after, high), walls=part.walls | {"south": name}),
    )


def _doors(rooms: Sequence[_Part], rng: np.random.Generator) -> list[Opening]:
    """Doorways by which every room is reached, and some more."""
    joints = [(a, b, *joint) for a, b in combinations(range(len(rooms)), 2) if (joint := _joint(rooms[a], rooms[b]))]
    group, doors = list(range(len(rooms))), []
    for k in rng.permutation(len(joints)).tolist():
        a, b, wall, begin, end = joints[k]
        more = rng.random() < MORE_DOORS
        if group[a] == group[b] and not more:
            continue
        group = [group[a] if each == group[b] else each for each in group]
        width = round(min(_length(rng, *DOOR_M), end - begin), 2)
        at = round(begin + float(rng.random()) * (end - begin - width), 2)
        doors.append(Opening(wall=wall, begin_m=at, end_m=round(at + width, 2)))
    return doors


def _joint(one: _Part, other: _Part) -> tuple[str, float, float] | None:
    """The wall between two rooms, and where a doorway may be in it; None if there is no room for one."""
    for side, opposite in (("east", "west"), ("north", "south")):
        for a, b in ((one, other), (other, one)):
            if a.walls[side] != b.walls[opposite]:
                continue
            spans = (a.y_m, b.y_m) if side == "east" else (a.x_m, b.x_m)
            begin = max(span[0] for span in spans) + DOOR_MARGIN_M
            end = min(span[1] for span in spans) - DOOR_MARGIN_M
            if end - begin >= DOOR_M[0] - 1e-6:
                return a.walls[side], round(begin, 2), round(end, 2)
    return None


def _windows(rooms: Sequence[_Part], rng: np.random.Generator) -> list[Opening]:
    windows = []
    for room in rooms:
        for side in ("north", "east", "south", "west"):
            if room.walls[side] != side or rng.random() > WINDOW_SHARE:
                continue
            low, high = room.x_m if side in ("north", "south") else room.y_m
            count = 1 if high - low < 3.4 else int(rng.integers(1, 3))
            stretch = (high - low) / count
            for k in range(count):
                width = min(_length(rng, *WINDOW_M), stretch - 2 * WINDOW_MARGIN_M)
                if width < WINDOW_M[0] / 2:
                    continue
                middle = low + (k + float(rng.uniform(0.4, 0.6))) * stretch
                begin = round(min(max(middle - width / 2, low + WINDOW_MARGIN_M / 2), high - width), 2)
                bottom, top = round(float(rng.uniform(0.7, 1.1)), 2), round(float(rng.uniform(2.0, 2.25)), 2)
                windows.append(
                    Opening(wall=side, begin_m=begin, end_m=round(begin + width, 2), bottom_m=bottom, top_m=top)
                )
    return windows


def _finished(name: str, room: _Part, rng: np.random.Generator) -> Room:
    coverings = {}
    if rng.random() < COVERED_SHARE and not room.is_hall:
        coverings[("north", "east", "south", "west")[int(rng.integers(4))]] = _covering(rng)
    return Room(
        name=f"hall {name}" if room.is_hall else name,
        x_m=room.x_m,
        y_m=room.y_m,
        walls=room.walls,
        paint=_PAINTS[int(rng.integers(len(_PAINTS)))],
        floor=_FLOORS[int(rng.integers(2 if room.is_hall else len(_FLOORS)))],
        coverings=coverings,
        panelled=room.is_hall and bool(rng.random() < 0.5),
    )


def _covering(rng: np.random.Generator) -> Covering:
    first, second = (_STRONG_PAINTS[k] for k in rng.permutation(len(_STRONG_PAINTS))[:2].tolist())
    finish = (Finish.PAINT, Finish.STRIPES, Finish.BRICKS)[int(rng.integers(3))]
    if finish is Finish.STRIPES:
        light: Colour = (0.5 + second[0] / 2, 0.5 + second[1] / 2, 0.5 + second[2] / 2)
        return Covering(finish=finish, colours=(first, light))
    return Covering(finish=finish, colours=(first,))


def _lamps(room: _Part) -> list[tuple[float, float, float]]:
    counts = [math.ceil(side / LAMP_EVERY_M) for side in room.sides_m]
    places = []
    for i in range(counts[0]):
        for j in range(counts[1]):
            x = room.x_m[0] + (i + 0.5) / counts[0] * room.sides_m[0]
            y = room.y_m[0] + (j + 0.5) / counts[1] * room.sides_m[1]
            places.append((round(x, 2), round(y, 2), CEILING_LAMP_M))
    return places
