"""Floor plans: rooms between walls, with doorways and windows; and the plan of the embedded flat."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from readygo.common.scenes.embedded.textures import Colour

CEILING_M = 2.6
OUTER_WALL_M = 0.2
WEST_M, EAST_M, SOUTH_M, NORTH_M = -5.2, 5.2, -4.8, 4.8


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A straight wall; `axis` is the direction that it crosses ("x" or "y"), `low_m..high_m` its thickness there."""

    axis: str
    low_m: float
    high_m: float
    begin_m: float
    end_m: float


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A doorway or a window in a wall, `begin_m..end_m` along it."""

    wall: str
    begin_m: float
    end_m: float
    bottom_m: float = 0.0
    top_m: float = 2.1

    @property
    def is_window(self) -> bool:
        """True for windows, False for doorways."""
        return self.bottom_m > 0


class Finish(Enum):
    """What a wall is covered with."""

    PAINT = "paint"
    STRIPES = "stripes"
    BRICKS = "bricks"


@dataclass(frozen=True, kw_only=True)
class Covering:
    """Finish of a wall of a room that differs from the room's paint."""

    finish: Finish = Finish.PAINT
    colours: tuple[Colour, ...] = ()
    """One of paint, two of stripes; bricks have their own."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """A rectangle of floor between four walls."""

    name: str
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    walls: dict[str, str]
    """Name of the wall on each side: north, east, south, west."""
    paint: Colour
    floor: str
    """One of oak, walnut, tiles, carpet."""
    coverings: Mapping[str, Covering] = field(default_factory=dict)
    """Walls that are not in the room's paint, by side."""
    panelled: bool = False
    """True for wooden panels along the walls."""


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """A flat's walls, openings and rooms; the walls "west", "east", "south" and "north" are the outer ones."""

    walls: Mapping[str, Wall]
    openings: tuple[Opening, ...]
    rooms: tuple[Room, ...]
    lamps_m: tuple[tuple[float, float, float], ...]
    """Where lamps below the ceiling shine: x, y, z."""

    @property
    def low_m(self) -> tuple[float, float]:
        """Least x and y between the outer walls [m]."""
        return self.walls["west"].high_m, self.walls["south"].high_m

    @property
    def high_m(self) -> tuple[float, float]:
        """Largest x and y between the outer walls [m]."""
        return self.walls["east"].low_m, self.walls["north"].low_m

    def openings_of(self, wall: str) -> list[Opening]:
        """The openings of one wall, sorted along it."""
        return sorted((o for o in self.openings if o.wall == wall), key=lambda o: o.begin_m)


_WALLS = {
    "west": Wall(axis="x", low_m=WEST_M - OUTER_WALL_M, high_m=WEST_M, begin_m=-5.0, end_m=5.0),
    "east": Wall(axis="x", low_m=EAST_M, high_m=EAST_M + OUTER_WALL_M, begin_m=-5.0, end_m=5.0),
    "south": Wall(axis="y", low_m=SOUTH_M - OUTER_WALL_M, high_m=SOUTH_M, begin_m=WEST_M, end_m=EAST_M),
    "north": Wall(axis="y", low_m=NORTH_M, high_m=NORTH_M + OUTER_WALL_M, begin_m=WEST_M, end_m=EAST_M),
    "hall_north": Wall(axis="y", low_m=0.5, high_m=0.6, begin_m=WEST_M, end_m=EAST_M),
    "hall_south": Wall(axis="y", low_m=-1.2, high_m=-1.1, begin_m=WEST_M, end_m=EAST_M),
    "middle_north": Wall(axis="x", low_m=0.5, high_m=0.6, begin_m=0.6, end_m=NORTH_M),
    "middle_south": Wall(axis="x", low_m=-0.2, high_m=-0.1, begin_m=SOUTH_M, end_m=-1.2),
}

_OPENINGS = (
    Opening(wall="hall_north", begin_m=-2.8, end_m=-0.9),
    Opening(wall="hall_north", begin_m=3.2, end_m=4.6),
    Opening(wall="hall_south", begin_m=-2.5, end_m=-1.2),
    Opening(wall="hall_south", begin_m=1.3, end_m=2.9),
    Opening(wall="middle_north", begin_m=1.0, end_m=2.7),
    Opening(wall="north", begin_m=-4.2, end_m=-2.6, bottom_m=0.8, top_m=2.2),
    Opening(wall="north", begin_m=-1.5, end_m=-0.3, bottom_m=0.8, top_m=2.2),
    Opening(wall="north", begin_m=2.4, end_m=3.8, bottom_m=1.1, top_m=2.1),
    Opening(wall="west", begin_m=1.5, end_m=2.9, bottom_m=0.8, top_m=2.2),
    Opening(wall="west", begin_m=-0.8, end_m=0.2, bottom_m=0.9, top_m=2.1),
    Opening(wall="east", begin_m=1.3, end_m=2.7, bottom_m=0.8, top_m=2.2),
    Opening(wall="east", begin_m=-0.8, end_m=0.2, bottom_m=0.3, top_m=2.1),
    Opening(wall="east", begin_m=-3.4, end_m=-2.2, bottom_m=0.8, top_m=2.2),
    Opening(wall="south", begin_m=-2.9, end_m=-1.3, bottom_m=0.8, top_m=2.2),
    Opening(wall="south", begin_m=1.9, end_m=3.7, bottom_m=0.8, top_m=2.2),
)

_ROOMS = (
    Room(
        name="living room",
        x_m=(WEST_M, 0.5),
        y_m=(0.6, NORTH_M),
        walls={"north": "north", "east": "middle_north", "south": "hall_north", "west": "west"},
        paint=(0.90, 0.87, 0.80),
        floor="oak",
        coverings={"west": Covering(colours=((0.50, 0.60, 0.53),))},
    ),
    Room(
        name="kitchen",
        x_m=(0.6, EAST_M),
        y_m=(0.6, NORTH_M),
        walls={"north": "north", "east": "east", "south": "hall_north", "west": "middle_north"},
        paint=(0.93, 0.91, 0.86),
        floor="tiles",
        coverings={"west": Covering(colours=((0.88, 0.72, 0.45),))},
    ),
    Room(
        name="hall",
        x_m=(WEST_M, EAST_M),
        y_m=(-1.1, 0.5),
        walls={"north": "hall_north", "east": "east", "south": "hall_south", "west": "west"},
        paint=(0.80, 0.85, 0.87),
        floor="oak",
        panelled=True,
    ),
    Room(
        name="bedroom",
        x_m=(WEST_M, -0.2),
        y_m=(SOUTH_M, -1.2),
        walls={"north": "hall_south", "east": "middle_south", "south": "south", "west": "west"},
        paint=(0.78, 0.83, 0.88),
        floor="carpet",
        coverings={"west": Covering(finish=Finish.STRIPES, colours=((0.62, 0.70, 0.80), (0.86, 0.87, 0.86)))},
    ),
    Room(
        name="study",
        x_m=(-0.1, EAST_M),
        y_m=(SOUTH_M, -1.2),
        walls={"north": "hall_south", "east": "east", "south": "south", "west": "middle_south"},
        paint=(0.89, 0.84, 0.76),
        floor="walnut",
        coverings={"east": Covering(finish=Finish.BRICKS)},
    ),
)

PENDANT_M, CEILING_LAMP_M = 1.62, 2.42
"""Heights of lamps: over a table, below the ceiling."""

FLAT = FloorPlan(
    walls=_WALLS,
    openings=_OPENINGS,
    rooms=_ROOMS,
    lamps_m=(
        (-2.35, 2.7, CEILING_LAMP_M),
        (2.9, 1.75, PENDANT_M),
        (-3.4, -0.3, CEILING_LAMP_M),
        (0.0, -0.3, CEILING_LAMP_M),
        (3.4, -0.3, CEILING_LAMP_M),
        (-2.7, -3.0, CEILING_LAMP_M),
        (2.6, -2.7, CEILING_LAMP_M),
    ),
)
"""The embedded flat: four rooms around a corridor."""


def pieces(begin_m: float, end_m: float, openings: list[Opening]) -> list[tuple[float, float, float, float]]:
    """Cut the openings out of a wall face.

    Returns:
        Rectangles (begin, end, bottom, top) [m] that cover the rest of the face.
    """
    rectangles = []
    cursor = begin_m
    for opening in openings:
        if opening.end_m <= begin_m or opening.begin_m >= end_m:
            continue
        if opening.begin_m > cursor:
            rectangles.append((cursor, opening.begin_m, 0.0, CEILING_M))
        if opening.bottom_m > 0:
            rectangles.append((opening.begin_m, opening.end_m, 0.0, opening.bottom_m))
        rectangles.append((opening.begin_m, opening.end_m, opening.top_m, CEILING_M))
        cursor = opening.end_m
    if cursor < end_m:
        rectangles.append((cursor, end_m, 0.0, CEILING_M))
    return rectangles
