import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL, UNREACHED
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert import ground as expert_ground
from readygo.services.planner.expert.ground import HIGH_FACTOR, SceneGround, crop_grid
from tests.services.planner.worlds import FRAME, rooms


def _ground(occupancy, **options):
    return SceneGround(occupancy, occupancy, None, RobotConfig(), EpisodeConfig(), ExpertConfig(**options))


def _long_detour():
    """A hall of 60 x 10 m that a wall cuts nearly to its end: the way round is 40 m and more."""
    occupied = np.zeros((200, 1200), np.bool_)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[98:101, :1100] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def test_a_window_lies_where_the_map_has_it():
    part, moved = crop_grid(FRAME, (200, 240), (0.0, 5.0), (1.0, 6.0), 1.0)
    assert moved.cell(0.0, 5.0) == (20, 20)
    assert (part[0].start, part[1].start) == (40, 40)
    assert moved.centre_m(3, 4) == pytest.approx(FRAME.centre_m(43, 44))
    whole, same = crop_grid(FRAME, (200, 240), (0.0, 5.0), (1.0, 6.0), math.inf)
    assert whole == (slice(0, 200), slice(0, 240))
    assert same.centre_m(0, 0) == FRAME.centre_m(0, 0)


def test_windows_are_small_unless_the_way_needs_more():
    hall = _long_detour()
    near = _ground(hall).around((0.0, 4.0), (3.0, 4.0))
    assert near.static_factor.shape[1] < 400
    across = _ground(hall).around((0.0, 4.0), (0.0, 10.0))
    assert across.static_factor.shape == (200, 1200)
    assert across.to_goal[across.frame.cell(0.0, 4.0)] * 0.05 / UNITS_PER_CELL > 90


def test_window_widens_once_and_not_beyond_its_bound():
    ground = _ground(_long_detour())
    near = ground.around((0.0, 4.0), (3.0, 4.0))
    wider = ground.wider(near, (0.0, 4.0), (3.0, 4.0))
    assert wider is not None
    assert wider.static_factor.shape[1] > near.static_factor.shape[1]
    assert ground.wider(wider, (0.0, 4.0), (3.0, 4.0)) is None


def test_ground_between_robots_radius_and_planning_radius_is_dear_and_the_rest_as_before():
    ground = _ground(rooms())
    tight = (ground.static_factor == 0) & (ground.tight_factor > 0)
    assert tight.any()
    assert (ground.tight_factor[tight] == HIGH_FACTOR).all()
    assert ground.clearance[tight].min() > RobotConfig().radius_m
    assert np.array_equal(ground.tight_factor[~tight], ground.static_factor[~tight])
    assert ground.static_factor[ground.clearance > 1.0].max() == FREE


def test_ways_of_humans_are_asked_for_by_who_may_guess_them_only():
    start, goal = (-2.0, 3.0), (2.0, 3.0)
    ways = _ground(rooms()).around(start, goal).human_ways
    assert len(ways) == 2
    assert ways[0][_ground(rooms()).around(start, goal).human_frame.cell(*start)] == 0
    assert _ground(rooms(), mode="paper").around(start, goal).human_ways == ()
    assert _ground(rooms(), oracle=True).around(start, goal).human_ways == ()


def test_way_out_leads_towards_the_goal_from_blocked_ground():
    local = _ground(rooms()).around((-2.0, 3.0), (2.0, 3.0))
    assert local.way_out_rad(-2.85, 3.0, 0.0, (2.0, 3.0)) == pytest.approx(0.0, abs=0.6)
    assert abs(local.way_out_rad(-2.85, 3.0, math.pi, (2.0, 3.0))) == pytest.approx(math.pi, abs=0.6)


def test_distances_tell_whether_the_goal_can_be_reached():
    local = _ground(rooms()).around((-2.0, 3.0), (2.0, 3.0))
    local.factor[:] = local.tight_factor
    assert local.distances(local.factor, -2.0, 3.0)
    assert local.heuristic[local.frame.cell(-2.0, 3.0)] < UNREACHED
    i, j = local.frame.cell(2.0, 3.0)
    local.factor[max(i - 8, 0) : i + 9, j - 8 : j + 9] = 0
    local.factor[i, j] = FREE
    assert not local.distances(local.factor, -2.0, 3.0)


def test_grids_of_robot_and_humans_may_differ():
    coarse = OccupancyMap(
        frame=GridFrame(origin_x_m=-3.0, origin_y_m=2.0, resolution_m=0.1), occupied=rooms().occupied[::2, ::2]
    )
    ground = SceneGround(rooms(), coarse, None, RobotConfig(), EpisodeConfig(), ExpertConfig())
    local = ground.around((-2.0, 3.0), (2.0, 3.0))
    assert local.human_frame.resolution_m == 0.1
    assert local.human_ways[0][local.human_frame.cell(-2.0, 3.0)] == 0


def test_ground_of_the_flat_for_a_crooked_robot_is_as_it_was(golden_figures, monkeypatch):
    monkeypatch.setattr(expert_ground, "WALL_COST", 0.9)
    monkeypatch.setattr(expert_ground, "WALL_DISTANCE_M", 0.31)
    robot = RobotConfig(radius_m=0.28, planning_radius_m=0.37)
    ground = SceneGround(rooms(), rooms(), None, robot, EpisodeConfig(), ExpertConfig())
    golden_figures(
        "expert/ground",
        ground.static_factor[::3, ::3].reshape(-1),
        ground.tight_factor[::3, ::3].reshape(-1),
        scale=0.3,
    )
    local = ground.around((-2.0, 3.1), (2.1, 8.3))
    golden_figures("expert/way to the goal", np.minimum(local.to_goal[::5, ::5].reshape(-1), 1 << 16), scale=1e-3)
    golden_figures(
        "expert/ways of humans",
        *[np.minimum(way[::5, ::5].reshape(-1), 1 << 16) for way in local.human_ways],
        scale=1e-3,
    )
    places = [(-2.8, 3.0, 0.4), (0.4, 3.4, 2.5), (2.96, 6.0, -1.0), (5.0, 9.9, 1.2)]
    golden_figures("expert/ways out", [local.way_out_rad(*place, (2.1, 8.3)) for place in places])
