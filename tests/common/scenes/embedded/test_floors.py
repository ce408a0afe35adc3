import numpy as np
import pytest

from readygo.common.scenes.embedded.floors import build_floors
from readygo.common.scenes.embedded.plan import FLAT, Room
from readygo.common.scenes.embedded.surfaces import UnlitPoints
from tests.common.scenes.embedded.parts import rows_of, samples_of


@pytest.fixture(scope="module")
def floors() -> UnlitPoints:
    return samples_of(lambda build: build_floors(build, FLAT))


@pytest.mark.parametrize("room", FLAT.rooms, ids=lambda room: room.name)
def test_every_square_of_a_room_has_floor(floors: UnlitPoints, room: Room) -> None:
    x, y, _ = floors.position_m.T
    bins = [np.linspace(*edge, round((edge[1] - edge[0]) / 0.4) + 1) for edge in (room.x_m, room.y_m)]
    assert np.histogram2d(x, y, bins=bins)[0].min() >= 4


def test_floor_looks_up_from_zero(floors: UnlitPoints) -> None:
    np.testing.assert_array_equal(floors.normal, np.tile((0.0, 0.0, 1.0), (len(floors.normal), 1)))
    assert floors.position_m[:, 2].min() == 0.0
    assert floors.position_m[:, 2].max() <= 0.002


def test_rooms_have_floors_of_their_own_colours(floors: UnlitPoints) -> None:
    x, y, _ = floors.position_m.T
    tones = {}
    for room in FLAT.rooms:
        inside = (x > room.x_m[0]) & (x < room.x_m[1]) & (y > room.y_m[0]) & (y < room.y_m[1])
        tones.setdefault(room.floor, np.median(floors.colour[inside], axis=0))
    walnut, oak, tiles = tones["walnut"], tones["oak"], tones["tiles"]
    assert walnut[0] < oak[0] - 0.1
    assert np.ptp(tiles) < 0.15 < np.ptp(oak)


def test_tiles_lie_like_a_chessboard(floors: UnlitPoints) -> None:
    x, y, z = floors.position_m.T
    kitchen = next(room for room in FLAT.rooms if room.floor == "tiles")
    inside = (x > kitchen.x_m[0]) & (x < kitchen.x_m[1]) & (y > kitchen.y_m[0]) & (y < kitchen.y_m[1]) & (z == 0)
    columns, rows = (round((edge[1] - edge[0]) / 0.33) for edge in (kitchen.x_m, kitchen.y_m))
    i = np.floor((x[inside] - kitchen.x_m[0]) / (kitchen.x_m[1] - kitchen.x_m[0]) * columns)
    j = np.floor((y[inside] - kitchen.y_m[0]) / (kitchen.y_m[1] - kitchen.y_m[0]) * rows)
    light = floors.colour[inside, 0] > 0.64
    assert (light == ((i + j) % 2 == 0)).mean() > 0.95


def test_floors_are_as_they_were(floors: UnlitPoints, golden_figures) -> None:
    golden_figures("embedded/floors", *rows_of(floors))
