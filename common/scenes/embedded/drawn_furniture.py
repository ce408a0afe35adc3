"""Furniture of flats whose plan is drawn: what a room is for, and what stands where it hides no doorway."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from readygo.common.scenes.embedded import decor, seating, storage
from readygo.common.scenes.embedded.free_floor import FreeFloor
from readygo.common.scenes.embedded.furnishing import DARK, OAK, WHITE, hang_lamps
from readygo.common.scenes.embedded.plan import FloorPlan, Room
from readygo.common.scenes.embedded.shell import facing_wall, local_openings
from readygo.common.scenes.embedded.surfaces import Surfaces
from readygo.common.scenes.embedded.textures import Colour
from readygo.common.scenes.embedded.variation import PIECE_RADIUS_M, add_piece

_TRIES = 12
"""Places that are tried for a piece of furniture."""
_DOORWAY_M = 0.9
"""Nothing stands so near in front of a doorway."""
_GAP_M = 0.06
_FREE_M = 0.4
"""Least distance of free furniture from walls."""
_SMALL_PIECES = (2, 8)
_PICTURES = 3
_SIDES = ("north", "east", "south", "west")
_BLUE, _GREEN, _RED, _SAND = (0.36, 0.48, 0.53), (0.38, 0.48, 0.36), (0.62, 0.26, 0.20), (0.80, 0.68, 0.48)
_RUG = (_RED, (0.90, 0.82, 0.66), (0.16, 0.22, 0.33))

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y [m]."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Something that stands with its back at a wall, or in the middle of a room."""

    width_m: float
    depth_m: float
    height_m: float
    build: Callable[[Surfaces], None]
    """Adds it: its back at y = 0 and centred in x, or its middle at the origin."""


@dataclass(kw_only=True)
class _Place:
    """A room that is being furnished."""

    room: Room
    doorways: list[Box]
    taken: list[Box] = field(default_factory=list)
    on_walls: dict[str, list[tuple[float, float, float]]] = field(default_factory=dict)
    """By side: begin, end and height of what stands at the wall [m]."""


def furnish_drawn(build: Surfaces, plan: FloorPlan, rng: np.random.Generator) -> None:
    """Furnish a drawn flat so that a robot still gets everywhere."""
    floor = FreeFloor(plan, build.samples().position_m)
    for room, pieces in zip(plan.rooms, _pieces_of_rooms(plan, rng), strict=True):
        place = _Place(room=room, doorways=_doorways(plan, room))
        for piece in pieces[0]:
            _stand_at_wall(build, plan, place, piece, floor, rng)
        for piece in pieces[1]:
            _stand_free(build, place, piece, floor, rng)
        _hang_pictures(build, plan, place, rng)
    hang_lamps(build, plan)
    _scatter(build, plan, rng)


def _pieces_of_rooms(plan: FloorPlan, rng: np.random.Generator) -> list[tuple[list[Piece], list[Piece]]]:
    """What is wanted in each room: at its walls, and free."""
    kinds = iter(rng.permutation(len(_KINDS)).tolist())
    wanted = []
    for room in plan.rooms:
        kind = _hall if room.name.startswith("hall") else _KINDS[next(kinds, int(rng.integers(len(_KINDS))))]
        wanted.append(kind(rng))
    return wanted


def _stand_at_wall(
    build: Surfaces, plan: FloorPlan, place: _Place, piece: Piece, floor: FreeFloor, rng: np.random.Generator
) -> None:
    for _ in range(_TRIES):
        side = _SIDES[int(rng.integers(4))]
        wall, length = facing_wall(build, place.room, side)
        if length < piece.width_m + 2 * _GAP_M:
            continue
        reach = length - piece.width_m - 2 * _GAP_M
        begin = round(_GAP_M + reach * float(rng.random()), 2)
        end = begin + piece.width_m
        cuts = local_openings(plan, place.room, side)
        if any(cut.begin_m < end and cut.end_m > begin and cut.bottom_m < piece.height_m for cut in cuts):
            continue
        box = _box_at_wall(place.room, side, (begin, end), piece.depth_m)
        if _is_free(place, box) and floor.take_box(box[:2], box[2:]):
            place.taken.append(box)
            place.on_walls.setdefault(side, []).append((begin, end, piece.height_m))
            piece.build(wall.at((begin + end) / 2, 0.0))
            return


def _stand_free(build: Surfaces, place: _Place, piece: Piece, floor: FreeFloor, rng: np.random.Generator) -> None:
    """Place a piece in the middle, at a right angle to the walls."""
    for _ in range(_TRIES):
        turned = bool(rng.integers(2))
        width, depth = (piece.depth_m, piece.width_m) if turned else (piece.width_m, piece.depth_m)
        (x0, x1), (y0, y1) = place.room.x_m, place.room.y_m
        if x1 - x0 < width + 2 * _FREE_M or y1 - y0 < depth + 2 * _FREE_M:
            continue
        x = round(float(rng.uniform(x0 + width / 2 + _FREE_M, x1 - width / 2 - _FREE_M)), 2)
        y = round(float(rng.uniform(y0 + depth / 2 + _FREE_M, y1 - depth / 2 - _FREE_M)), 2)
        box = (x - width / 2, y - depth / 2, x + width / 2, y + depth / 2)
        if _is_free(place, box) and floor.take_box(box[:2], box[2:]):
            place.taken.append(box)
            piece.build(build.at(x, y, yaw_deg=90.0 * turned))
            return


def _hang_pictures(build: Surfaces, plan: FloorPlan, place: _Place, rng: np.random.Generator) -> None:
    """Hang pictures above what is low, and beside what is high."""
    for _ in range(_PICTURES):
        side, motif = _SIDES[int(rng.integers(4))], int(rng.integers(5))
        size = round(float(rng.uniform(0.5, 1.0)), 2), round(float(rng.uniform(0.5, 0.8)), 2)
        wall, length = facing_wall(build, place.room, side)
        if length < size[0] + 0.4:
            continue
        begin = round(0.2 + (length - size[0] - 0.4) * float(rng.random()), 2)
        end = begin + size[0]
        taken = [(cut.begin_m, cut.end_m, cut.top_m) for cut in local_openings(plan, place.room, side)]
        taken += place.on_walls.get(side, [])
        if any(b < end + 0.1 and e > begin - 0.1 and height > 1.0 for b, e, height in taken):
            continue
        place.on_walls.setdefault(side, []).append((begin, end, 2.0))
        decor.picture(wall.at((begin + end) / 2, 0.0), motif, size, z_m=round(float(rng.uniform(1.45, 1.65)), 2))


def _scatter(build: Surfaces, plan: FloorPlan, rng: np.random.Generator) -> None:
    """Stand small pieces wherever a robot still gets by."""
    floor = FreeFloor(plan, build.samples().position_m)
    wanted = int(rng.integers(*_SMALL_PIECES))
    doorways = [box for room in plan.rooms for box in _doorways(plan, room)]
    for _ in range(20 * wanted):
        room = plan.rooms[int(rng.integers(len(plan.rooms)))]
        x, y = (round(float(rng.uniform(*span)), 1) for span in (room.x_m, room.y_m))
        r = PIECE_RADIUS_M
        if any(_overlap((x - r, y - r, x + r, y + r), box) for box in doorways):
            continue
        if floor.take_disc(x, y, r):
            add_piece(build.at(x, y, yaw_deg=float(rng.integers(360))), rng)
            wanted -= 1
        if not wanted:
            return


def _doorways(plan: FloorPlan, room: Room) -> list[Box]:
    """What stays free in front of a room's doorways."""
    return [
        _box_at_wall(room, side, (cut.begin_m - 0.1, cut.end_m + 0.1), _DOORWAY_M)
        for side in room.walls
        for cut in local_openings(plan, room, side)
        if not cut.is_window
    ]


def _box_at_wall(room: Room, side: str, along_m: tuple[float, float], depth_m: float) -> Box:
    """A rectangle at a wall; `along_m` is measured from the wall's left corner, seen from the room."""
    (x0, x1), (y0, y1), (begin, end) = room.x_m, room.y_m, along_m
    if side == "north":
        return x0 + begin, y1 - depth_m, x0 + end, y1
    if side == "south":
        return x1 - end, y0, x1 - begin, y0 + depth_m
    if side == "west":
        return x0, y0 + begin, x0 + depth_m, y0 + end
    return x1 - depth_m, y1 - end, x1, y1 - begin


def _is_free(place: _Place, box: Box) -> bool:
    grown = box[0] - _GAP_M, box[1] - _GAP_M, box[2] + _GAP_M, box[3] + _GAP_M
    return not any(_overlap(grown, other) for other in (*place.taken, *place.doorways))


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _one_of(rng: np.random.Generator, *colours: Colour) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _width(rng: np.random.Generator, low_m: float, high_m: float) -> float:
    return round(float(rng.uniform(low_m, high_m)), 2)


def _living_room(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_sofa(rng), _television(rng), _bookshelf(rng), _armchair(rng), _sideboard(rng), _plant(rng)], [_rug(rng)]


def _kitchen(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_counter(rng), _fridge(), _sideboard(rng), _plant(rng)], [_dining_table(rng)]


def _dining_room(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_sideboard(rng), _bookshelf(rng), _plant(rng), _armchair(rng)], [_dining_table(rng)]


def _bedroom(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_bed(rng), _wardrobe(rng), _sideboard(rng), _plant(rng)], [_rug(rng)]


def _study(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_desk(rng), _bookshelf(rng), _bookshelf(rng), _armchair(rng), _plant(rng)], [_round_table(rng)]


def _hall(rng: np.random.Generator) -> tuple[list[Piece], list[Piece]]:
    return [_bench(rng), _sideboard(rng, depth_m=0.3), _plant(rng)], []


_KINDS: Sequence[Callable[[np.random.Generator], tuple[list[Piece], list[Piece]]]] = (
    _living_room,
    _kitchen,
    _bedroom,
    _study,
    _dining_room,
)


def _sofa(rng: np.random.Generator) -> Piece:
    width = _width(rng, 1.6, 2.3)

    def build(at: Surfaces) -> None:
        seating.sofa(at, (0.40, 0.46, 0.52), width_m=width, seats=2 if width < 1.9 else 3)

    return Piece(width_m=width, depth_m=0.92, height_m=0.8, build=build)


def _armchair(rng: np.random.Generator) -> Piece:
    colour = _one_of(rng, (0.78, 0.55, 0.24), (0.50, 0.24, 0.20), _GREEN)

    def build(at: Surfaces) -> None:
        seating.sofa(at, colour, width_m=0.92, seats=1, accent=(0.25, 0.38, 0.42))

    return Piece(width_m=0.92, depth_m=0.92, height_m=0.8, build=build)


def _television(rng: np.random.Generator) -> Piece:
    width, colour = _width(rng, 1.3, 1.8), _one_of(rng, DARK, OAK, WHITE)

    def build(at: Surfaces) -> None:
        storage.sideboard(at, width, 0.52, colour)
        decor.television(at, 0.52)

    return Piece(width_m=width, depth_m=0.45, height_m=1.26, build=build)


def _sideboard(rng: np.random.Generator, depth_m: float = 0.42) -> Piece:
    width, height, colour = _width(rng, 0.8, 1.5), _width(rng, 0.6, 0.9), _one_of(rng, OAK, DARK, WHITE, _BLUE)
    lit = bool(rng.integers(2))

    def build(at: Surfaces) -> None:
        storage.sideboard(at, width, height, colour, depth_m=depth_m, doors=2 if width < 1.1 else 3)
        top = at.at(-0.2, -depth_m / 2)
        if lit:
            decor.table_lamp(top, height)
        else:
            decor.vase(top, height, (0.25, 0.42, 0.50))

    return Piece(width_m=width, depth_m=depth_m + 0.04, height_m=height + 0.4, build=build)


def _bookshelf(rng: np.random.Generator) -> Piece:
    width, height, colour = _width(rng, 0.9, 2.0), _width(rng, 1.2, 2.1), _one_of(rng, WHITE, DARK, OAK)

    def build(at: Surfaces) -> None:
        storage.bookshelf(at, width, height, colour, shelves=3 if height < 1.5 else 5)

    return Piece(width_m=width, depth_m=0.30, height_m=height, build=build)


def _plant(rng: np.random.Generator) -> Piece:
    height, is_palm = _width(rng, 0.8, 1.5), bool(rng.integers(2))

    def build(at: Surfaces) -> None:
        (decor.palm if is_palm else decor.potted_plant)(at.at(0.0, -0.42), height)

    return Piece(width_m=0.7, depth_m=0.75, height_m=height, build=build)


def _counter(rng: np.random.Generator) -> Piece:
    width, colour = _width(rng, 1.9, 3.1), _one_of(rng, _BLUE, _GREEN, WHITE)
    modules = round(width / 0.6)

    def build(at: Surfaces) -> None:
        left = at.at(-width / 2, 0.0)
        storage.kitchen_counter(left, width, colour, modules=modules)
        storage.backsplash(left, 0.0, width, 1.42)
        storage.wall_cupboard(left, width / 2, colour, modules=max(1, modules // 2))
        storage.sink(left, 0.25 * width)
        storage.oven(left, 0.75 * width)

    return Piece(width_m=width, depth_m=0.66, height_m=2.2, build=build)


def _fridge() -> Piece:
    return Piece(width_m=0.7, depth_m=0.7, height_m=1.82, build=storage.fridge)


def _bed(rng: np.random.Generator) -> Piece:
    cover, throw = _one_of(rng, (0.38, 0.50, 0.60), _GREEN, _RED), _one_of(rng, (0.82, 0.58, 0.34), _SAND)

    def build(at: Surfaces) -> None:
        seating.bed(at, cover, throw)

    return Piece(width_m=1.76, depth_m=2.16, height_m=1.05, build=build)


def _wardrobe(rng: np.random.Generator) -> Piece:
    width, colour = _width(rng, 1.0, 2.2), _one_of(rng, (0.82, 0.78, 0.70), OAK, WHITE)

    def build(at: Surfaces) -> None:
        storage.wardrobe(at, width, colour)

    return Piece(width_m=width, depth_m=0.64, height_m=2.1, build=build)


def _desk(rng: np.random.Generator) -> Piece:
    width, colour = _width(rng, 1.2, 1.8), _one_of(rng, (0.55, 0.39, 0.25), WHITE, OAK)

    def build(at: Surfaces) -> None:
        seating.table(at.at(0.0, -0.40), (width, 0.75, 0.74), colour, seed=9)
        decor.monitor_desk_set(at.at(0.0, -0.22), 0.74)
        seating.office_chair(at.at(0.0, -1.05, yaw_deg=195.0), (0.20, 0.24, 0.28))

    return Piece(width_m=width, depth_m=1.4, height_m=1.3, build=build)


def _bench(rng: np.random.Generator) -> Piece:
    width = _width(rng, 0.9, 1.3)

    def build(at: Surfaces) -> None:
        seating.bench(at, OAK, width_m=width)
        decor.coat_rack(at)

    return Piece(width_m=max(width, 1.0), depth_m=0.36, height_m=1.75, build=build)


def _dining_table(rng: np.random.Generator) -> Piece:
    width, padded = _width(rng, 1.2, 1.8), _one_of(rng, (0.72, 0.30, 0.24), _BLUE, _SAND)

    def build(at: Surfaces) -> None:
        seating.table(at, (width, 0.85, 0.75), OAK, seed=5)
        decor.fruit_bowl(at.at(0.1, 0.05), 0.75)
        for x in (-width / 4, width / 4):
            seating.chair(at.at(x, 0.52), (0.82, 0.66, 0.45), padded=padded)
            seating.chair(at.at(x, -0.52, yaw_deg=180.0), (0.82, 0.66, 0.45), padded=padded)

    return Piece(width_m=width, depth_m=1.6, height_m=0.95, build=build)


def _round_table(rng: np.random.Generator) -> Piece:
    radius = _width(rng, 0.35, 0.5)

    def build(at: Surfaces) -> None:
        seating.round_table(at, radius, 0.6, OAK)
        decor.vase(at, 0.6, (0.35, 0.50, 0.55), flowers=(0.70, 0.50, 0.80))

    return Piece(width_m=2 * radius, depth_m=2 * radius, height_m=1.0, build=build)


def _rug(rng: np.random.Generator) -> Piece:
    """A low table on a rug, which may lie below other furniture."""
    width, depth = _width(rng, 1.2, 0.9 + 2 * _FREE_M), _width(rng, 0.8, 0.55 + 2 * _FREE_M)

    def build(at: Surfaces) -> None:
        decor.rug(at, width, depth, _RUG)
        seating.table(at, (0.9, 0.55, 0.42), OAK)

    return Piece(width_m=0.9, depth_m=0.55, height_m=0.42, build=build)
