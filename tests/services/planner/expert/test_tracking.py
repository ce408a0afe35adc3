import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert.ground import SceneGround
from readygo.services.planner.expert.hybrid_astar import Plan
from readygo.services.planner.expert.records import State
from readygo.services.planner.expert.tracking import PathTracker
from tests.services.planner.worlds import hall, rooms

ROBOT, Y_M = RobotConfig(), 6.0


@pytest.fixture
def tracker():
    config = ExpertConfig(mode="paper")
    ground = SceneGround(rooms(), rooms(), None, ROBOT, EpisodeConfig(), config)
    return PathTracker(ground.around((-2.0, Y_M), (2.0, Y_M)), ROBOT, ground.contact_m)


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


@pytest.mark.parametrize(("control_hz", "a_max_mps2"), [(20, 1.0), (10, 0.6), (30, 1.7)])
def test_slower_stretch_ahead_is_reached_with_braking_to_spare(control_hz, a_max_mps2):
    """A robot of other rates and limits follows a bent path on which the speed falls and ends at rest."""
    robot = RobotConfig(
        control_hz=control_hz, camera_hz=10, v_max_mps=1.3, w_max_radps=1.9, a_max_mps2=a_max_mps2, alpha_max_radps2=5.0
    )
    config, dt_s = ExpertConfig(mode="paper"), robot.clock.dt_s
    ground = SceneGround(rooms(), rooms(), None, robot, EpisodeConfig(), config)
    follower = PathTracker(ground.around((-2.0, Y_M), (2.0, Y_M)), robot, ground.contact_m)
    angles = np.arange(0.0, 1.6, 0.02)
    xyyaw = np.column_stack([-2.6 + 2.1 * np.sin(angles), Y_M - 2.1 + 2.1 * np.cos(angles), -angles])
    wanted_mps = np.where(angles < 0.9, 1.3, 0.3)
    wanted_mps[-1] = 0.0
    follower.follow(Plan(xyyaw=xyyaw, speed_mps=wanted_mps, cost=4.0, expansion_count=1), 0.0)
    planned_mps = follower.path[:, 3]
    gaps_m = np.hypot(*np.diff(xyyaw[:, :2], axis=0).T)
    assert np.all(planned_mps <= wanted_mps)
    braking = planned_mps[:-1] < wanted_mps[:-1]
    rates = (planned_mps[:-1] ** 2 - planned_mps[1:] ** 2) / (2 * gaps_m)
    assert rates[braking] == pytest.approx(np.full(braking.sum(), 0.9 * a_max_mps2))
    assert braking.sum() > 5

    state, commands = State(*xyyaw[0].tolist(), 0.0, 0.0), []
    for _ in range(round(9.0 / dt_s)):
        follower.update(state.x_m, state.y_m)
        assert follower.gap_m(state.x_m, state.y_m) < 0.08
        v, w = follower.command(state)
        assert v <= 0.12 + math.sqrt(planned_mps[follower.progress] ** 2 + 2 * a_max_mps2 * v * dt_s)
        commands.append((v, w))
        state = State(*step_unicycle(state.x_m, state.y_m, state.yaw_rad, v, w, dt_s), v, w)
    v, w = np.array(commands).T
    assert v.min() >= 0.0
    assert v.max() <= robot.v_max_mps
    assert abs(w).max() <= robot.w_max_radps
    assert np.abs(np.diff(v, prepend=0.0)).max() <= a_max_mps2 * dt_s + 1e-9
    assert np.abs(np.diff(w, prepend=0.0)).max() <= robot.alpha_max_radps2 * dt_s + 1e-9
    assert follower.progress >= len(angles) - 3


def settled(control_hz, state, turn_rad=0.0):
    """Yaw rates [rad/s] and headings [rad] over 8 s of a robot that is commanded so often on a straight path."""
    robot = RobotConfig(control_hz=control_hz, camera_hz=20)
    ground = SceneGround(hall(), hall(), None, robot, EpisodeConfig(), ExpertConfig(mode="paper"))
    follower = PathTracker(ground.around((-2.0, Y_M), (7.0, Y_M)), robot, ground.contact_m)
    x = np.arange(-2.0, 7.5, 0.05)
    xyyaw = np.column_stack([x, np.full(len(x), Y_M), np.zeros(len(x))])
    follower.follow(Plan(xyyaw=xyyaw, speed_mps=np.ones(len(x)), cost=9.0, expansion_count=1), turn_rad)
    rates, headings = [], []
    for step in range(160):
        follower.update(state.x_m, state.y_m)
        if robot.clock.commands(step):
            wanted = follower.command(state, held_steps=robot.clock.held_for(step))
        v, w = limit_command(*wanted, state.v_mps, state.w_radps, robot, DT_S)
        state = State(*step_unicycle(state.x_m, state.y_m, state.yaw_rad, v, w, DT_S), v, w)
        rates.append(w)
        headings.append(state.yaw_rad)
    return np.array(rates), np.array(headings)


@pytest.mark.parametrize("control_hz", [20, 10, 5, 2, 1])
def test_robot_that_is_commanded_seldom_comes_to_its_path_without_oscillating(control_hz):
    for state in (State(-2.0, Y_M - 0.05, 0.0, 0.0, 0.0), State(-2.0, Y_M + 0.1, 0.1, 1.0, 0.0)):
        rates, headings = settled(control_hz, state)
        assert np.sqrt(np.mean(rates[60:] ** 2)) < 0.02
        assert np.abs(headings[100:]).max() < 0.01
        turns = np.sign(rates[np.abs(rates) > 0.02])
        assert (np.diff(turns) != 0).sum() <= 2


@pytest.mark.parametrize("control_hz", [20, 10, 5, 2, 1])
@pytest.mark.parametrize("yaw_rad", [-2.0, 1.3])
def test_turn_in_place_of_a_robot_that_is_commanded_seldom_does_not_pass_its_heading(control_hz, yaw_rad):
    _, headings = settled(control_hz, State(-2.0, Y_M, yaw_rad, 0.0, 0.0), turn_rad=yaw_rad)
    side = np.sign(yaw_rad)
    assert (side * headings).min() > -0.1
    assert abs(headings[-1]) < 0.02


@pytest.mark.parametrize("held_steps", [1, 4, 20])
def test_command_is_what_the_robot_reaches_while_it_is_held(tracker, held_steps):
    tracker.follow(straight(), 0.0)
    v, _ = tracker.command(State(-2.0, Y_M, 0.0, 0.0, 0.0), held_steps=held_steps)
    assert v == pytest.approx(min(held_steps * ROBOT.a_max_mps2 * DT_S, ROBOT.v_max_mps))
    _, w = tracker.turn(State(-2.0, Y_M, 0.0, 0.0, 0.0), 3.0, held_steps=held_steps)
    assert w == pytest.approx(min(held_steps * ROBOT.alpha_max_radps2 * DT_S, ROBOT.w_max_radps))


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
