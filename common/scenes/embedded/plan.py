"""The flat's floor plan: four rooms around a corridor, with doorways and windows."""

from dataclasses import dataclass

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


WALLS = {
    "west": Wall(axis="x", low_m=WEST_M - OUTER_WALL_M, high_m=WEST_M, begin_m=-5.0, end_m=5.0),
    "east": Wall(axis="x", low_m=EAST_M, high_m=EAST_M + OUTER_WALL_M, begin_m=-5.0, end_m=5.0),
    "south": Wall(axis="y", low_m=SOUTH_M - OUTER_WALL_M, high_m=SOUTH_M, begin_m=WEST_M, end_m=EAST_M),
    "north": Wall(axis="y", low_m=NORTH_M, high_m=NORTH_M + OUTER_WALL_M, begin_m=WEST_M, end_m=EAST_M),
    "hall_north": Wall(axis="y", low_m=0.5, high_m=0.6, begin_m=WEST_M, end_m=EAST_M),
    "hall_south": Wall(axis="y", low_m=-1.2, high_m=-1.1, begin_m=WEST_M, end_m=EAST_M),
    "middle_north": Wall(axis="x", low_m=0.5, high_m=0.6, begin_m=0.6, end_m=NORTH_M),
    "middle_south": Wall(axis="x", low_m=-0.2, high_m=-0.1, begin_m=SOUTH_M, end_m=-1.2),
}

OPENINGS = (
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

ROOMS = (
    Room(
        name="living room",
        x_m=(WEST_M, 0.5),
        y_m=(0.6, NORTH_M),
        walls={"north": "north", "east": "middle_north", "south": "hall_north", "west": "west"},
        paint=(0.90, 0.87, 0.80),
        floor="oak",
    ),
    Room(
        name="kitchen",
        x_m=(0.6, EAST_M),
        y_m=(0.6, NORTH_M),
        walls={"north": "north", "east": "east", "south": "hall_north", "west": "middle_north"},
        paint=(0.93, 0.91, 0.86),
        floor="tiles",
    ),
    Room(
        name="hall",
        x_m=(WEST_M, EAST_M),
        y_m=(-1.1, 0.5),
        walls={"north": "hall_north", "east": "east", "south": "hall_south", "west": "west"},
        paint=(0.80, 0.85, 0.87),
        floor="oak",
    ),
    Room(
        name="bedroom",
        x_m=(WEST_M, -0.2),
        y_m=(SOUTH_M, -1.2),
        walls={"north": "hall_south", "east": "middle_south", "south": "south", "west": "west"},
        paint=(0.78, 0.83, 0.88),
        floor="carpet",
    ),
    Room(
        name="study",
        x_m=(-0.1, EAST_M),
        y_m=(SOUTH_M, -1.2),
        walls={"north": "hall_south", "east": "east", "south": "south", "west": "middle_south"},
        paint=(0.89, 0.84, 0.76),
        floor="walnut",
    ),
)


def openings_of(wall: str) -> list[Opening]:
    """The openings of one wall, sorted along it."""
    return sorted((o for o in OPENINGS if o.wall == wall), key=lambda o: o.begin_m)


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
