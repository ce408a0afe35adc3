import numpy as np
import pytest

from readygo.common.scenes.embedded.furnishing import furnish
from readygo.common.scenes.embedded.plan import CEILING_M, EAST_M, FLAT, NORTH_M, SOUTH_M, WEST_M, Opening, Room
from readygo.common.scenes.embedded.surfaces import UnlitPoints
from tests.common.scenes.embedded.parts import extent, rows_of, samples_of


@pytest.fixture(scope="module")
def furniture() -> UnlitPoints:
    return samples_of(furnish)


def within(samples: UnlitPoints, room: Room) -> np.ndarray:
    x, y, _ = samples.position_m.T
    return (x > room.x_m[0]) & (x < room.x_m[1]) & (y > room.y_m[0]) & (y < room.y_m[1])


def test_furniture_stands_inside_of_the_walls(furniture: UnlitPoints) -> None:
    low, high = extent(furniture)
    assert (low >= (WEST_M - 0.01, SOUTH_M - 0.01, -1e-6)).all()
    assert (high <= (EAST_M + 0.01, NORTH_M + 0.01, CEILING_M + 1e-6)).all()


@pytest.mark.parametrize("room", FLAT.rooms, ids=lambda room: room.name)
def test_every_room_is_furnished_and_has_a_lamp(furniture: UnlitPoints, room: Room) -> None:
    assert (within(furniture, room) & (furniture.position_m[:, 2] > 0.05)).sum() > 700
    lamps = [(x, y) for x, y, z in FLAT.lamps_m if room.x_m[0] < x < room.x_m[1] and room.y_m[0] < y < room.y_m[1]]
    assert lamps
    for lamp in lamps:
        over = np.hypot(*(furniture.position_m[:, :2] - lamp).T) < 0.25
        assert (over & furniture.glows & (furniture.position_m[:, 2] > 1.5)).any()
    assert max(z for _, _, z in FLAT.lamps_m) < CEILING_M


@pytest.mark.parametrize("door", [opening for opening in FLAT.openings if not opening.is_window])
def test_nothing_stands_in_a_doorway(furniture: UnlitPoints, door: Opening) -> None:
    wall = FLAT.walls[door.wall]
    x, y, z = furniture.position_m.T
    along, across = (x, y) if wall.axis == "y" else (y, x)
    middle = np.abs(along - (door.begin_m + door.end_m) / 2) < 0.3
    near = (across > wall.low_m - 0.4) & (across < wall.high_m + 0.4)
    assert not (middle & near & (z > 0.05) & (z < 1.9)).any()


def test_furniture_is_as_it_was(furniture: UnlitPoints, golden_figures) -> None:
    golden_figures("embedded/furniture", *rows_of(furniture))
