import numpy as np
import pytest

from readygo.common.robot.standing import STAND_M, STAND_S, WAIT_S
from readygo.common.state_policy.commands import StateCommands
from readygo.common.state_policy.state_policy import StatePolicy
from tests.common.state_policy.state_policies import make_state_policy

HERE = (1.0, 2.0)
LATE_S = STAND_S + 10.0
WAIT = (0.0, 0.0)


@pytest.fixture
def policy() -> StatePolicy:
    """A policy whose best command is to wait."""
    policy = make_state_policy(seed=3)
    waits = (policy.commands == 0.0).all(axis=1)
    assert waits.sum() == 1
    policy.layers[-1][1][:] += np.where(waits, np.float32(20.0), np.float32(0.0))
    return policy


@pytest.fixture
def told(policy: StatePolicy) -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, 0.1, (1, policy.layers[0][0].shape[1])).astype(np.float32)


def decided(commands: StateCommands, told: np.ndarray, times_s, xy_m=HERE, *, alone: bool = True) -> set:
    return {
        tuple(commands.decide(told, np.array([time_s]), np.array([xy_m]), np.array([alone]))[0]) for time_s in times_s
    }


def test_robot_that_stands_too_long_takes_the_best_command_that_moves(policy: StatePolicy, told: np.ndarray) -> None:
    commands = StateCommands(policy)
    assert decided(commands, told, np.arange(0.0, STAND_S - 0.1, 0.2)) == {WAIT}
    scores = policy.logits(told)[0]
    moving = np.flatnonzero(policy.commands[:, 0])
    best = tuple(policy.commands[moving[scores[moving].argmax()]])
    assert decided(commands, told, np.arange(STAND_S, LATE_S, 0.2)) == {best}


def test_turning_on_the_spot_is_standing(policy: StatePolicy, told: np.ndarray) -> None:
    turns = (policy.commands[:, 0] == 0.0) & (policy.commands[:, 1] > 0.0)
    policy.layers[-1][1][:] += np.where(turns, np.float32(60.0), np.float32(0.0))
    commands = StateCommands(policy)
    assert {v for v, _ in decided(commands, told, [0.0])} == {0.0}
    assert {v for v, _ in decided(commands, told, [STAND_S])} != {0.0}


def test_robot_that_moves_keeps_the_best_command(policy: StatePolicy, told: np.ndarray) -> None:
    commands = StateCommands(policy)
    for time_s in np.arange(0.0, LATE_S, 0.2):
        assert decided(commands, told, [time_s], (0.2 * time_s, 0.0)) == {WAIT}


def test_robot_waits_longer_for_a_person(policy: StatePolicy, told: np.ndarray) -> None:
    commands = StateCommands(policy)
    assert decided(commands, told, np.arange(0.0, WAIT_S - 0.1, 0.2), alone=False) == {WAIT}
    assert WAIT not in decided(commands, told, [WAIT_S], alone=False)


def test_leaving_the_place_ends_it(policy: StatePolicy, told: np.ndarray) -> None:
    commands, away = StateCommands(policy), (HERE[0] + STAND_M + 0.01, HERE[1])
    assert len(decided(commands, told, [0.0, LATE_S])) == 2
    assert decided(commands, told, LATE_S + np.arange(0.0, STAND_S - 0.1, 0.2), away) == {WAIT}


def test_robots_stand_for_themselves(policy: StatePolicy, told: np.ndarray) -> None:
    commands, alone = StateCommands(policy, 3), np.array([True, True, False])
    places = np.array([HERE, HERE, HERE])
    commands.decide(told.repeat(3, axis=0), np.zeros(3), places, alone)
    places[1] += 1.0
    later = commands.decide(told.repeat(3, axis=0), np.full(3, STAND_S), places, alone)
    assert (later[:, 0] != 0.0).tolist() == [True, False, False]
