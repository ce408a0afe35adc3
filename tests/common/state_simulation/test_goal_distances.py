import math

import numpy as np
import pytest

from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.state_simulation.goal_distances import (
    GoalDistances,
    coarse_place,
    point_ahead,
    remaining_m,
)

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.05)


@pytest.fixture
def room() -> OccupancyMap:
    """10 x 6 m, a wall across at x = 4 with a door at y 2.5 .. 3.5."""
    occupied = np.zeros((121, 201), np.bool_)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[:90, 100] = True
    occupied[110:, 100] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def test_remaining_distance_is_that_of_the_path_around(room: OccupancyMap) -> None:
    field, place = GoalDistances(room, 0.3).to_goal_cm((7.0, 0.0)), coarse_place(FRAME)
    assert remaining_m(field, place, 5.0, 0.0) == pytest.approx(2.0, abs=0.1)
    around = math.dist((2.0, 0.0), (4.0, 2.9)) + math.dist((4.0, 2.9), (7.0, 0.0))
    assert around - 0.1 < remaining_m(field, place, 2.0, 0.0) < 1.12 * around
    assert remaining_m(field, place, 4.5, 0.02) == pytest.approx(remaining_m(field, place, 4.5, 0.04), abs=0.05)


def test_blocked_cells_and_places_outside_have_distances_too(room: OccupancyMap) -> None:
    field, place = GoalDistances(room, 0.3).to_goal_cm((7.0, 0.0)), coarse_place(FRAME)
    assert remaining_m(field, place, 8.95, 0.0) > remaining_m(field, place, 8.5, 0.0)
    assert 0.0 < remaining_m(field, place, 50.0, 50.0) < 100.0


def test_point_ahead_leads_through_the_door_and_stays_at_the_goal(room: OccupancyMap) -> None:
    field, place = GoalDistances(room, 0.3).to_goal_cm((7.0, 0.0)), coarse_place(FRAME)
    x, y = 2.0, 0.0
    for _ in range(20):
        x, y = point_ahead(field, place, x, y, 6)
    assert math.dist((x, y), (7.0, 0.0)) < 0.11
    through = point_ahead(field, place, 3.0, 2.9, 16)
    assert through[0] > 4.2


def test_goal_in_an_obstacle_is_a_goal(room: OccupancyMap) -> None:
    field = GoalDistances(room, 0.3).to_goal_cm((4.02, 0.0))
    assert field.min() < 10
