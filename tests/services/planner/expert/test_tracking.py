import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert.ground import SceneGround
from readygo.services.planner.expert.hybrid_astar import Plan
from readygo.services.planner.expert.records import State
from readygo.services.planner.expert.tracking import PathTracker
from tests.services.planner.worlds import rooms

ROBOT, Y_M = RobotConfig(), 6.0


@pytest.fixture
def tracker():
    config = ExpertConfig(mode="paper")
    ground = SceneGround(rooms(), rooms(), None, ROBOT, EpisodeConfig(), config)
    return PathTracker(ground.around((-2.0, Y_M), (2.0, Y_M)), ROBOT, ground.contact_m, config)


def straight(speed_mps=1.0):
    x = np.arange(-2.0, 2.0, 0.05)
    xyyaw = np.column_stack([x, np.full(len(x), Y_M), np.zeros(len(x))])
    return Plan(xyyaw=xyyaw, speed_mps=np.full(len(x), speed_mps), cost=4.0, expansion_count=1)


def driven(tracker, state, steps, humans=None):
    """States of a robot that follows its commands, and the commands."""
    states, commands = [state], []
    for _ in range(steps):
        tracker.update(state.x_m, state.y_m)
        v, w = tracker.command(state, np.empty((0, 1, 2)) if humans is None else humans)
        yaw = state.yaw_rad + 0.5 * w * DT_S
        state = State(state.x_m + v * DT_S * math.cos(yaw), state.y_m + v * DT_S * math.sin(yaw), yaw, v, w)
        states.append(state)
        commands.append((v, w))
    return states, np.array(commands)


def test_robot_beside_its_path_comes_back_to_it_within_its_limits(tracker):
    tracker.follow(straight(), 0.0)
    states, commands = driven(tracker, State(-2.0, Y_M - 0.2, 0.0, 0.0, 0.0), 60)
    assert abs(states[-1].y_m - Y_M) < 0.03
    assert np.abs(np.diff(commands[:, 0], prepend=0.0)).max() <= ROBOT.a_max_mps2 * DT_S + 1e-9
    assert np.abs(np.diff(commands[:, 1], prepend=0.0)).max() <= ROBOT.alpha_max_radps2 * DT_S + 1e-9
    assert commands[-1, 0] == pytest.approx(ROBOT.v_max_mps, abs=0.05)
    assert tracker.progress > 20


def test_plan_that_begins_with_another_heading_is_turned_to_in_place_first(tracker):
    tracker.follow(straight(), math.pi / 2)
    assert tracker.turning
    states, _ = driven(tracker, State(-2.0, Y_M, math.pi / 2, 0.0, 0.0), 20)
    assert np.hypot(states[10].x_m + 2.0, states[10].y_m - Y_M) < 0.01
    assert states[10].yaw_rad < math.pi / 2 - 0.1
    driven(tracker, states[-1], 40)
    assert not tracker.turning


def test_robot_brakes_for_a_human_on_its_path_and_not_for_one_aside(tracker):
    tracker.follow(straight(), 0.0)
    state = State(-1.0, Y_M, 0.0, 0.8, 0.0)
    ahead, aside = (np.full((1, 40, 2), place) for place in ((0.2, Y_M), (0.2, Y_M - 1.6)))
    tracker.update(state.x_m, state.y_m)
    assert tracker.command(state, aside)[0] > 0.8
    assert tracker.command(state, ahead)[0] < 0.8


def test_gap_is_to_the_reached_point(tracker):
    tracker.follow(straight(), 0.0)
    tracker.update(-1.52, Y_M + 0.3)
    assert tracker.gap_m(-1.5, Y_M + 0.3) == pytest.approx(0.3, abs=1e-6)
