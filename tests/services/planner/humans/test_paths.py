from dataclasses import replace

import numpy as np
import pytest

from readygo.common.maps import clearance_m
from readygo.services.planner.humans import paths
from readygo.services.planner.humans.config import SPACINGS
from readygo.services.planner.humans.paths import HumanPathPlanner, keeps_clear
from readygo.services.planner.humans.polyline import length_m
from readygo.services.planner.humans.spline import smallest_distance
from tests.services.planner.worlds import FRAME, hall, rooms

WIDE = SPACINGS["wide"]
PLACE = (FRAME.origin_x_m, FRAME.origin_y_m, FRAME.resolution_m)
AROUND_THE_CORNER = [(-1.8, 6.3), (2.1, 7.9)]
"""Aslant through a door of the flat."""


def nearest_m(path, occupancy):
    return smallest_distance(path, clearance_m(occupancy).astype(np.float64), *PLACE)


@pytest.mark.parametrize("clearance", [0.35, 0.375])
def test_path_that_was_smoothed_into_a_corner_is_pushed_off_until_it_keeps_its_clearance(clearance, monkeypatch):
    # With hardly any push the first spline cuts the corner.
    monkeypatch.setattr(paths, "_WEIGHTS", (0.2, 20.0, 0.2))
    cut, kept = (
        HumanPathPlanner(rooms(), replace(WIDE, clearance_m=least_m), iterations=60).path(AROUND_THE_CORNER)
        for least_m in (0.01, clearance)
    )
    assert nearest_m(cut, rooms()) < 0.2
    assert nearest_m(kept, rooms()) >= clearance


def test_path_passes_near_its_points_and_none_leads_where_nobody_can_walk():
    planner = HumanPathPlanner(rooms(), WIDE, iterations=60)
    path = planner.path(AROUND_THE_CORNER)
    assert path[[0, -1]] == pytest.approx(np.array(AROUND_THE_CORNER), abs=1e-9)
    assert planner.path([AROUND_THE_CORNER[0], (-2.99, 6.3)]) is None
    assert planner.searches == 1


def test_detour_beyond_its_limit_is_refused():
    planner = HumanPathPlanner(rooms(), WIDE, iterations=60)
    through_the_next_door = [(1.5, 8.0), (4.4, 8.0)]
    assert planner.path(through_the_next_door, detour_max=1.0) is None
    path = planner.path(through_the_next_door)
    assert 3.4 < length_m(path) < 5.2


def test_point_in_a_wall_settles_on_the_nearest_walkable_cell():
    planner = HumanPathPlanner(hall(), WIDE, iterations=60)
    edge_x = FRAME.origin_x_m + 10 * FRAME.resolution_m
    settled = planner.nearest_walkable((edge_x - 0.1, 7.0), 0.6)
    assert settled[0] == pytest.approx(edge_x + 0.4, abs=0.05)
    assert abs(settled[1] - 7.0) <= 0.05
    assert planner.nearest_walkable((edge_x - 0.1, 7.0), 0.3) is None
    assert planner.nearest_walkable((2.0, 7.0), 0.0) == (2.0, 7.0)


def test_reach_is_what_is_wanted_or_ends_before_the_wall():
    planner = HumanPathPlanner(hall(), WIDE, iterations=60)
    last_x = FRAME.origin_x_m + 230 * FRAME.resolution_m - 0.375
    assert planner.reach_m((2.0, 7.0), (1.0, 0.0), 3.0) == 3.0
    assert planner.reach_m((2.0, 7.0), (1.0, 0.0), 50.0) == pytest.approx(last_x - 2.0, abs=0.16)
    assert planner.reach_m((-2.99, 7.0), (1.0, 0.0), 1.0) == 0.0


def test_disc_keeps_clear_of_a_wall_up_to_its_radius():
    edge_x = FRAME.origin_x_m + 10 * FRAME.resolution_m
    row = np.array([[2.0, 7.0], [edge_x + 0.26, 7.0]])
    assert keeps_clear(hall(), row, 0.25)
    assert not keeps_clear(hall(), row, 0.27)


def test_paths_through_the_flat_are_as_they_were(golden_figures, monkeypatch):
    monkeypatch.setattr(paths, "_WEIGHTS", (150.0, 1.3, 0.02))
    planner = HumanPathPlanner(rooms(), WIDE, iterations=60)
    ways = [AROUND_THE_CORNER, [(-2.1, 3.3), (2.6, 4.4), (5.7, 5.9)], [(6.6, 10.3), (4.1, 8.2), (-1.3, 10.9)]]
    planned = [planner.path(way, detour_max=2.5) for way in ways]
    golden_figures("humans/paths", np.concatenate(planned))
    golden_figures(
        "humans/settled", [planner.nearest_walkable(place, 0.9) for place in ((-2.9, 3.1), (0.4, 3.7), (2.95, 8.1))]
    )
    reaches = [planner.reach_m((-1.1, 5.3), (np.cos(a), np.sin(a)), 3.7) for a in np.arange(0.1, 6.3, 0.37)]
    golden_figures("humans/reaches", reaches)
    golden_figures("humans/parts", [planner.component(place) for place in ((-1.0, 5.0), (6.0, 10.0), (0.4, 3.5))])
    kept = [keeps_clear(rooms(), path, radius_m) for path in planned for radius_m in (0.2, 0.3, 0.35, 0.4, 0.5, 0.7)]
    golden_figures("humans/kept clear", kept)
