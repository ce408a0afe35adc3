import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra train")

from experiments.planning.imitation import RAYS
from experiments.policy import given_state
from experiments.policy.given_state import (
    AHEAD_STEPS,
    EVERY,
    HUMAN_WIDTH,
    Course,
    Learner,
    Senses,
    driven,
    learned,
    scores,
    summary,
    without_humans,
)
from readygo.common.messages import Outcome, Split
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import COMMAND_COUNT, HUMAN, command_grid

WIDTH = RAYS + 7 + 2 * HUMAN_WIDTH


@pytest.fixture(scope="module")
def course():
    return Course("embedded", None, seed=3)


@pytest.fixture(scope="module")
def episode(course):
    return next(course.episodes(Split.VAL))


@pytest.fixture
def small_batches(monkeypatch):
    monkeypatch.setattr(given_state, "BATCH", 32)


def samples_of(learner, told, command, risks, count=40):
    """What the learner takes up: everywhere the same."""
    ahead = tuple((0.0, 0.0) if step != AHEAD_STEPS else command for step in range(AHEAD_STEPS + 1))
    learner.add([told] * count, SimpleNamespace(expert_commands=[ahead] * count, risks=[bytes(risks)] * count))


def test_senses_tell_goal_speed_and_known_humans_in_the_robots_frame(course):
    pose = SimpleNamespace(x_m=1.0, y_m=1.0, yaw_rad=math.pi / 2, goal_xy_robot_m=(3.0, 4.0), v_mps=0.5, w_radps=-0.2)
    far = SimpleNamespace(x_m=1.0, y_m=5.0, vx_mps=0.0, vy_mps=1.0, age_s=0.0)
    near = SimpleNamespace(x_m=-1.0, y_m=1.0, vx_mps=1.0, vy_mps=0.0, age_s=0.5)
    gone = SimpleNamespace(x_m=1.0, y_m=1.5, vx_mps=0.0, vy_mps=0.0, age_s=2.0)
    expert = SimpleNamespace(act=lambda _: SimpleNamespace(perceived=(far, near, gone)))
    senses = Senses(SimpleNamespace(rays=lambda _: [0.0] * RAYS), expert)
    senses.step(pose)
    (told,) = senses.told
    np.testing.assert_allclose(told[:RAYS], 1.0)
    np.testing.assert_allclose(told[RAYS:][:7], [0.3, 0.4, 0.6, 0.8, math.exp(-2.5), 0.5, -0.2], rtol=1e-6)
    first, second = told[RAYS + 7 :].reshape(2, HUMAN_WIDTH)
    np.testing.assert_allclose(first, [1, 0, 0.5, 0, -1, math.exp(-2 / 1.5), 1], atol=1e-6)
    np.testing.assert_allclose(second, [1, 1, 0, 1, 0, math.exp(-4 / 1.5), 0], atol=1e-6)


def test_humans_that_are_not_known_are_zeros(course, episode):
    still = without_humans(episode)
    simulation, expert = course.planner.simulation(*still), course.planner.expert(*still)
    senses = Senses(course.eyes, expert)
    senses.step(simulation)
    (told,) = senses.told
    assert told.shape == (WIDTH,)
    assert not told[RAYS + 7 :].any()
    assert still[0].goal_xy_m is episode[0].goal_xy_m


@pytest.mark.parametrize("output", ["regression", "bins", "weighed"])
def test_every_output_learns_the_command_ahead_in_the_robots_units(output, small_batches):
    robot = RobotConfig()
    learner, told = Learner(output, 0.0, robot, seed=0), np.ones(WIDTH, np.float32)
    command = (0.5 * robot.v_max_mps, -0.5 * robot.w_max_radps)
    samples_of(learner, told, command, [0] * COMMAND_COUNT)
    assert len(learner) == 40 / EVERY
    learner.learn(200, 1e-3)
    np.testing.assert_allclose(learner.command(told), command, atol=0.1)


def test_caution_leaves_the_experts_command_where_it_risks_a_human(small_batches):
    robot = RobotConfig()
    learner, told = Learner("weighed", 0.0, robot, seed=0), np.ones(WIDTH, np.float32)
    risks = np.where(command_grid()[:, 0] > 0, HUMAN, 0).astype(np.uint8)
    samples_of(learner, told, (robot.v_max_mps, 0.0), risks)
    learner.learn(200, 1e-3)
    assert learner.command(told)[0] > 0.9 * robot.v_max_mps
    learner.caution = 50.0
    assert learner.command(told)[0] < 0.1 * robot.v_max_mps


def test_learner_drives_and_learns_on_its_own_states(course, episode):
    learner = Learner("weighed", 9.0, course.planner.robot, seed=0)
    learned(course, learner, rounds=2, samples=30, steps=2, seed=0)
    assert len(learner) >= 60
    done, told = driven(course, episode, learner)
    assert len(told) == len(done.expert_commands) == len(done.risks) == len(done.trajectory.actions)
    by_expert, _ = driven(course, episode, None)
    assert not np.array_equal(done.trajectory.actions[:5], by_expert.trajectory.actions[:5])


def test_scores_are_of_both_tasks(course, episode):
    row = scores(course, None, [episode])
    json.dumps(row)
    assert row["static"]["outcomes"] == {"success": 1}
    assert row["static"]["success"] == 100.0
    assert sum(row["dynamic"]["outcomes"].values()) == 1


def test_failures_count_as_the_time_limit():
    runs = [
        SimpleNamespace(outcome=Outcome.SUCCESS, duration_s=10.0, actions=np.array([(1.0, 0.1), (1.0, 0.0)])),
        SimpleNamespace(outcome=Outcome.HUMAN_COLLISION, duration_s=3.0, actions=np.zeros((3, 2))),
    ]
    found = summary(runs, 50.0)
    assert (found["success"], found["art_s"], found["turn_change_radps2"]) == (50.0, 30.0, 1.0)
    assert found["outcomes"] == {"success": 1, "human_collision": 1}
