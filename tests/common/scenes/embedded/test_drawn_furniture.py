"""Furniture of drawn flats: within the walls, not in front of doorways, and a robot still gets by."""

import numpy as np
import pytest

from readygo.common.scenes.embedded.drawn_furniture import furnish_drawn
from readygo.common.scenes.embedded.drawn_plan import draw_plan
from readygo.common.scenes.embedded.free_floor import FreeFloor
from readygo.common.scenes.embedded.plan import CEILING_M
from readygo.common.scenes.embedded.shell import build_shell
from readygo.common.scenes.embedded.surfaces import Surfaces


class Flat:
    """A drawn flat: its plan, points on its walls, and points on its furniture, shape (N, 3)."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.plan = draw_plan(rng)
        build = Surfaces(np.random.default_rng(seed))
        build_shell(build, self.plan)
        self.walls_m = build.samples().position_m
        furnish_drawn(build, self.plan, rng)
        self.samples = build.samples()
        known = {tuple(row) for row in self.walls_m.tolist()}
        self.is_furniture = np.array([tuple(row) not in known for row in self.samples.position_m.tolist()])
        self.furniture_m = self.samples.position_m[self.is_furniture]


@pytest.fixture(scope="module", params=[0, 2, 5])
def flat(request: pytest.FixtureRequest) -> Flat:
    return Flat(request.param)


def test_furniture_stands_inside_of_the_walls(flat: Flat) -> None:
    low, high = np.array([*flat.plan.low_m, 0.0]), np.array([*flat.plan.high_m, CEILING_M])
    # Leaves of plants may reach into a wall.
    assert (flat.furniture_m >= low - 0.15).all()
    assert (flat.furniture_m <= high + 0.15).all()
    x, y, _ = flat.furniture_m[flat.furniture_m[:, 2] < 0.3].T
    for wall in flat.plan.walls.values():
        along, across = (x, y) if wall.axis == "y" else (y, x)
        inside = (along > wall.begin_m + 0.05) & (along < wall.end_m - 0.05)
        assert not (inside & (across > wall.low_m + 0.03) & (across < wall.high_m - 0.03)).any()


def test_every_room_has_furniture_and_a_lamp(flat: Flat) -> None:
    x, y, z = flat.furniture_m.T
    glows = flat.samples.glows[flat.is_furniture]
    for room in flat.plan.rooms:
        here = (x > room.x_m[0]) & (x < room.x_m[1]) & (y > room.y_m[0]) & (y < room.y_m[1])
        assert (here & (z > 0.1) & (z < 1.5)).sum() > 50
        assert (here & glows & (z > 2.0)).any()


def test_nothing_stands_in_front_of_a_doorway(flat: Flat) -> None:
    for door in flat.plan.openings:
        if door.is_window:
            continue
        wall = flat.plan.walls[door.wall]
        x, y, z = flat.furniture_m.T
        along, across = (x, y) if wall.axis == "y" else (y, x)
        within = (along > door.begin_m + 0.02) & (along < door.end_m - 0.02) & (z > 0.06) & (z < 1.9)
        near = (across > wall.low_m - 0.8) & (across < wall.high_m + 0.8)
        assert not (within & near).any()


def test_windows_stay_open(flat: Flat) -> None:
    for window in (opening for opening in flat.plan.openings if opening.is_window):
        wall = flat.plan.walls[window.wall]
        x, y, z = flat.furniture_m.T
        along, across = (x, y) if wall.axis == "y" else (y, x)
        near = (across > wall.low_m - 0.3) & (across < wall.high_m + 0.3)
        before = (along > window.begin_m + 0.1) & (along < window.end_m - 0.1)
        tall = (z > window.bottom_m + 0.6) & (z < window.top_m)
        assert not (near & before & tall).any()


def test_robot_still_gets_almost_everywhere(flat: Flat) -> None:
    empty = FreeFloor(flat.plan, flat.walls_m).area_m2
    furnished = FreeFloor(flat.plan, flat.samples.position_m).area_m2
    assert 0.35 * empty < furnished < 0.9 * empty


def test_same_seed_furnishes_alike() -> None:
    np.testing.assert_array_equal(Flat(3).furniture_m, Flat(3).furniture_m)
