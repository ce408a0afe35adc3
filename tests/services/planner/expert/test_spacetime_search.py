import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, meets_obstacle
from readygo.common.maps import OccupancyMap
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert.ground import SceneGround
from readygo.services.planner.expert.records import HumansAhead
from readygo.services.planner.expert.spacetime import NEARNESS_COST
from readygo.services.planner.expert.spacetime_search import SpaceTimeSearch
from readygo.services.planner.expert.timed_primitives import make_timed_primitives
from tests.services.planner.worlds import FRAME, rooms

ROBOT = RobotConfig()
CONFIG = ExpertConfig()
CONTACT_M = 0.53
STEPS = 80


def _humans(*paths):
    expected_m = np.array(paths).reshape(-1, STEPS, 2)
    count = len(expected_m)
    return HumansAhead(
        expected_m=expected_m,
        chances=np.ones(count),
        contact_m=CONTACT_M,
        widths_m=np.full((count, STEPS), 0.2),
        weight=NEARNESS_COST,
    )


def _plan(state, goal_m, humans, occupancy=None, robot=ROBOT, horizon_s=4.0):
    occupancy = occupancy or rooms()
    ground = SceneGround(occupancy, occupancy, None, robot, EpisodeConfig(), CONFIG)
    local = ground.around(state[:2], goal_m)
    search = SpaceTimeSearch(robot, horizon_s=horizon_s, goal_tolerance_m=0.5)
    return search.search(local.tight_factor, local.to_goal, local.obstacles, state, goal_m, humans)


def _gaps(plan, path):
    count = min(len(plan.rows) - 1, STEPS)
    return np.hypot(*(plan.rows[1 : count + 1, :2] - np.array(path)[:count]).T)


def test_plan_starts_at_the_state_keeps_the_limits_and_touches_nothing():
    state = (-2.0, 3.0, 0.4, 0.37, -0.21)
    plan = _plan(state, (2.0, 6.0), _humans())
    assert tuple(plan.rows[0]) == state
    assert np.abs(np.diff(plan.rows[:, 3])).max() <= ROBOT.a_max_mps2 * DT_S + 1e-9
    assert np.abs(np.diff(plan.rows[:, 4])).max() <= ROBOT.alpha_max_radps2 * DT_S + 1e-9
    assert plan.rows[:, 3].min() >= 0
    assert plan.rows[:, 3].max() <= ROBOT.v_max_mps
    driven_m = np.hypot(*np.diff(plan.rows[:, :2], axis=0).T)
    assert np.allclose(driven_m, plan.rows[1:, 3] * DT_S, atol=1e-4)
    assert not any(meets_obstacle(rooms(), x, y, ROBOT.radius_m) for x, y in plan.rows[:, :2].tolist())


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(1, 20), (1, 7), (3, 3), (7, 7), (30, 30)])
@pytest.mark.parametrize("horizon_s", [4.0, 8.0])
def test_plans_reach_no_farther_than_the_horizon(control_hz, camera_hz, horizon_s):
    robot = RobotConfig(control_hz=control_hz, camera_hz=camera_hz)
    open_map = OccupancyMap(frame=FRAME, occupied=np.zeros((200, 400), np.bool_))
    plan = _plan((-2.0, 7.0, 0.0, 0.0, 0.0), (16.0, 7.0), _humans(), open_map, robot, horizon_s)
    reach_s = (len(plan.rows) - 1) * robot.clock.dt_s
    primitive_s = robot.clock.dt_s * make_timed_primitives(robot).steps
    assert horizon_s - primitive_s < reach_s <= horizon_s + 1e-9


@pytest.mark.parametrize(("control_hz", "reach_s"), [(20, 4.0), (10, 4.0), (5, 3.2), (2, 4.0)])
def test_plans_have_eight_primitives_where_these_fit_into_the_horizon(control_hz, reach_s):
    robot = RobotConfig(control_hz=control_hz, camera_hz=20)
    open_map = OccupancyMap(frame=FRAME, occupied=np.zeros((200, 400), np.bool_))
    plan = _plan((-2.0, 7.0, 0.0, 0.0, 0.0), (16.0, 7.0), _humans(), open_map, robot)
    assert (len(plan.rows) - 1) * robot.clock.dt_s == pytest.approx(reach_s)


def test_ground_is_free_before_a_human_comes_and_after_it_has_gone():
    """Somebody crosses the door ahead, early or late: the robot passes both times, and never where they are."""
    state, goal_m = (0.1, 6.0, math.pi / 2, 1.0, 0.0), (0.1, 9.0)
    free_m = float(np.hypot(*(_plan(state, goal_m, _humans()).rows[40, :2] - state[:2])))
    early = [(0.9 - 0.06 * k, 7.4) for k in range(STEPS)]
    late = [(4.4 - 0.06 * k, 7.4) for k in range(STEPS)]
    for path in (early, late):
        plan = _plan(state, goal_m, _humans(path))
        assert _gaps(plan, path).min() > CONTACT_M
        assert math.hypot(*(plan.rows[-1, :2] - goal_m)) < 0.5 or len(plan.rows) == STEPS + 1
    passed = _plan(state, goal_m, _humans(late)).rows
    assert np.hypot(*(passed[40, :2] - state[:2])) > 0.9 * free_m
    waited = _plan(state, goal_m, _humans(early)).rows
    assert waited[:20, 3].min() < 0.9


def test_robot_in_a_niche_that_looks_at_its_wall_turns_instead_of_waiting():
    """Walls on three sides leave no slope of the way across the robot."""
    occupied = np.ones((80, 120), np.bool_)
    occupied[36:51, 4:116] = False
    ground = OccupancyMap(frame=FRAME, occupied=occupied)
    y_m = FRAME.origin_y_m + 43.5 * FRAME.resolution_m
    plan = _plan((2.3, y_m, 0.0, 0.0, 0.0), (-2.0, y_m), _humans(), ground)
    assert abs(plan.rows[20, 2]) > 0.5
    assert plan.rows[-1, 0] < 2.0


def test_no_plan_where_the_robot_cannot_take_a_step():
    state, goal_m = (-2.0, 3.0, 0.0, 0.0, 0.0), (2.0, 6.0)
    occupancy = rooms()
    ground = SceneGround(occupancy, occupancy, None, ROBOT, EpisodeConfig(), CONFIG)
    local = ground.around(state[:2], goal_m)
    blocked = np.zeros_like(local.tight_factor)
    search = SpaceTimeSearch(ROBOT, horizon_s=4.0, goal_tolerance_m=0.5)
    assert search.search(blocked, local.to_goal, local.obstacles, state, goal_m, _humans()) is None


@pytest.mark.parametrize("chance", [1.0, 0.2])
def test_a_human_who_surrounds_the_robot_still_leaves_a_least_evil(chance):
    state, goal_m = (0.0, 5.0, 0.0, 0.0, 0.0), (2.0, 5.0)
    humans = HumansAhead(
        expected_m=np.full((1, STEPS, 2), (0.1, 5.0)),
        chances=np.array([chance]),
        contact_m=CONTACT_M,
        widths_m=np.full((1, STEPS), 0.2),
        weight=NEARNESS_COST,
    )
    plan = _plan(state, goal_m, humans)
    assert plan is not None
    assert np.hypot(*(plan.rows[-1, :2] - (0.1, 5.0))) > CONTACT_M


@pytest.mark.parametrize("yaw", [-0.5, 0.5])
def test_robots_that_turn_slowly_turn_towards_their_way(yaw):
    slow, open_map = RobotConfig(w_max_radps=0.1), OccupancyMap(frame=FRAME, occupied=np.zeros((200, 400), np.bool_))
    plan = _plan((0.0, 7.0, yaw, 0.0, 0.0), (8.0, 7.0), _humans(), open_map, slow)
    assert abs(math.remainder(plan.rows[-1, 2], math.tau)) < abs(yaw) - 0.25


def test_plans_of_a_crooked_robot_among_people_are_as_they_were(golden_figures):
    robot = RobotConfig(
        radius_m=0.28, planning_radius_m=0.35, v_max_mps=0.9, v_min_mps=-0.4, w_max_radps=1.4, a_max_mps2=0.8,
        alpha_max_radps2=2.6,
    )  # fmt: skip
    k = np.arange(STEPS)
    paths = [np.column_stack([0.6 - 0.02 * k, 7.1 - 0.03 * k]), np.column_stack([1.4 - 0.05 * k, 5.1 + 0 * k])]
    humans = _humans(*paths)._replace(chances=np.array([0.7, 0.4]))
    for number, (state, goal_m) in enumerate(
        [((-2.0, 3.0, 2.5, 0.37, -0.21), (2.0, 6.0)), ((0.1, 5.3, -1.1, -0.2, 0.6), (0.3, 9.0))]
    ):
        for name, who in (("people", humans), ("nobody", _humans())):
            plan = _plan(state, goal_m, who, robot=robot)
            golden_figures(f"expert/search {number} {name}", plan.rows)
            golden_figures(f"expert/search cost {number} {name}", [plan.cost])
