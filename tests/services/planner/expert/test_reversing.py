"""The experts' robots drive backwards where that is the better way, or the only one."""

from dataclasses import replace

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import Outcome, Scenario
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.expert.config import GEAR_COST_M, REVERSE_COST
from readygo.services.planner.expert.handlers import drive
from readygo.services.planner.expert.hybrid_astar import make_primitives
from readygo.services.planner.expert.records import State, robot_limits
from readygo.services.planner.expert.rollouts import limit_command, nearest_ahead, slow_ahead
from readygo.services.planner.expert.timed_primitives import make_timed_primitives
from tests.services.planner.worlds import animate, key, maps_of

FORWARD = RobotConfig()
BACKWARD = replace(FORWARD, v_min_mps=-0.5)


def dead_end():
    """A corridor, 1.2 m wide and 6 m long, that is closed where the robot stands before its end."""
    occupied = np.ones((60, 140), np.bool_)
    occupied[18:42, 10:130] = False
    return OccupancyMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.05), occupied=occupied)


def driven(robot, goal_x_m, **expert):
    """The expert's run from 0.5 m before the wall, which the robot looks at."""
    planner = RobotPlanner(maps_of(dead_end()), {}, robot, EpisodeConfig(), ExpertConfig(**expert))
    scenario = Scenario(
        episode=key(0), start_xyyaw=np.array([6.0, 1.5, 0.0]), goal_xy_m=np.array([goal_x_m, 1.5]), humans=()
    )
    return drive(planner, scenario, animate(scenario))


def test_robot_that_hardly_turns_leaves_a_dead_end_backwards_or_not_at_all():
    stiff = {"w_max_radps": 0.05}
    assert driven(replace(FORWARD, **stiff), 1.5).outcome is Outcome.TIMEOUT
    run = driven(replace(BACKWARD, **stiff), 1.5)
    assert run.outcome is Outcome.SUCCESS
    assert run.actions[:, 0].min() == -0.5
    assert run.actions[:, 0].max() <= 0.0
    assert run.duration_s < 10.0


@pytest.mark.parametrize("mode", ["spacetime", "paper"])
def test_short_way_back_is_driven_backwards_and_a_robot_that_cannot_turns_first(mode):
    slow = {"w_max_radps": 0.5}
    back, turned = (driven(replace(robot, **slow), 4.3, mode=mode) for robot in (BACKWARD, FORWARD))
    assert (back.outcome, turned.outcome) == (Outcome.SUCCESS, Outcome.SUCCESS)
    assert back.actions[:, 0].min() < -0.2
    assert turned.actions[:, 0].min() == 0.0
    assert back.duration_s < turned.duration_s


def test_expert_keeps_the_robots_rates_and_does_not_leave_its_plan_for_them():
    robot = replace(BACKWARD, control_hz=10, camera_hz=30)
    run = driven(robot, 1.5)
    assert run.outcome is Outcome.SUCCESS
    assert run.rate_hz == 30
    changes = np.abs(np.diff(run.actions, axis=0, prepend=0.0))
    assert changes[:, 0].max() <= robot.a_max_mps2 / 30 + 1e-9
    # Every replan is at a step at which the robot is commanded, a quarter of a second apart or more.
    planned = np.flatnonzero(run.replanned)
    assert not (planned % 3).any()
    assert np.diff(planned).min() >= 6


def test_primitives_backwards_cost_more_and_so_does_the_change():
    primitives, plain = make_timed_primitives(BACKWARD), make_timed_primitives(FORWARD)
    assert primitives.rules.v_levels.tolist() == [-0.5, *plain.rules.v_levels.tolist()]
    turns, table = primitives.turn_level_count, primitives.table
    standing = turns + turns // 2
    group = range(int(table.first[standing]), int(table.first[standing + 1]))
    straight = {round(float(table.rows[q, -1, 3]), 6): q for q in group if not table.rows[q, :, 4].any()}
    assert sorted(straight) == [-0.5, 0.0, 0.5]
    back, ahead = straight[-0.5], straight[0.5]
    assert table.rows[back, -1, 0] == pytest.approx(-table.rows[ahead, -1, 0])
    extra_m = float(table.costs[back] - table.costs[ahead])
    assert extra_m == pytest.approx(GEAR_COST_M + REVERSE_COST * table.lengths_m[back])


def test_paths_backwards_are_arcs_too():
    primitives = make_primitives(BACKWARD)
    ends = [primitives.offsets[p, primitives.sample_counts[p] - 1] for p in range(len(primitives.costs))]
    assert len(ends) == 15
    for p in range(9, 15):
        assert primitives.speeds_mps[p] < 0
        assert ends[p][0] < 0
    # To the left of the way back the heading turns to the right.
    assert ends[11][2] > 0 > ends[11][1]


def test_commands_backwards_are_within_the_limits():
    state = State(0.0, 0.0, 0.0, -0.48, 0.0)
    assert limit_command(-2.0, 0.0, state, robot_limits(BACKWARD)) == pytest.approx((-0.5, 0.0))
    assert limit_command(-2.0, 0.0, State(0.0, 0.0, 0.0, 0.0, 0.0), robot_limits(FORWARD)) == (0.0, 0.0)


def test_stretch_that_leads_the_other_way_is_begun_slowly_where_the_one_before_it_ends():
    ahead = [(0.05 * k, 0.0, 0.0, 1.0) for k in range(20)]
    back = [(0.95 - 0.05 * k, 0.0, 0.0, -0.5) for k in range(1, 15)]
    path = np.array(ahead + back)
    slow_ahead(path, 0.9)
    assert path[19, 3] == pytest.approx(np.sqrt(0.15**2 + 2 * 0.9 * 0.05))
    assert (path[20:, 3] < 0).all()
    # The way back lies over the way there: the robot is on it once it has come to the end.
    assert nearest_ahead(path, 12, 0.7, 0.0) == 14
    assert nearest_ahead(path, 18, 0.93, 0.0) == 20
