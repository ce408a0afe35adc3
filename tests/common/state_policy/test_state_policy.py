import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import PolicyError
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.state_policy import (
    ACTOR_FILE,
    STATE_POLICY_FILE,
    STATE_POLICY_FORMAT,
    StatePolicySpec,
    commands_of,
    forward,
    grid_weights,
    hold_steps_of,
    is_state_policy,
    load_state_policy,
)
from tests.common.state_policy.state_policies import TOLD_COUNT, make_state_policy, write_state_policy


def test_policy_comes_back_from_its_folder(tmp_path: Path) -> None:
    policy, told = make_state_policy(), np.random.default_rng(1).normal(size=(5, TOLD_COUNT)).astype(np.float32)
    assert not is_state_policy(tmp_path)
    policy.save(tmp_path)
    assert is_state_policy(tmp_path)
    loaded = load_state_policy(tmp_path)
    assert loaded.spec == policy.spec
    assert np.array_equal(loaded.choose(told), policy.choose(told))
    assert loaded.choose(told).shape == (5, 2)


def test_negative_values_do_not_pass_hidden_layers() -> None:
    layers = [(np.float32([[1.0], [-1.0]]), np.float32([0.0, 0.0])), (np.float32([[1.0, 1.0]]), np.float32([-5.0]))]
    assert forward(layers, np.float32([[2.0], [-3.0]])).tolist() == [[-3.0], [-2.0]]


def test_damage_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="no usable state policy"):
        load_state_policy(tmp_path)
    folder = write_state_policy(tmp_path / "policy")
    text = (folder / STATE_POLICY_FILE).read_text()
    (folder / STATE_POLICY_FILE).write_text(text.replace(STATE_POLICY_FORMAT, "readygo-state-policy/1"))
    with pytest.raises(PolicyError, match="train it again"):
        load_state_policy(folder)
    (folder / STATE_POLICY_FILE).write_text(text)
    np.savez(folder / ACTOR_FILE, w0=np.zeros((3, TOLD_COUNT), np.float32), b0=np.zeros(3, np.float32))
    with pytest.raises(PolicyError, match="do not fit"):
        load_state_policy(folder)
    np.savez(folder / ACTOR_FILE, weights=np.zeros((3, TOLD_COUNT), np.float32))
    with pytest.raises(PolicyError, match="layers"):
        load_state_policy(folder)


def test_commands_are_held_for_whole_steps_of_the_robot() -> None:
    robot = dataclasses.replace(RobotConfig(), control_hz=10)
    assert hold_steps_of(robot, 0.2) == 4
    assert StatePolicySpec(robot=robot, scenes={}, hold_s=0.3).hold_steps == 6
    with pytest.raises(PolicyError, match="multiple"):
        hold_steps_of(robot, 0.25)


def test_weights_of_a_command_are_those_of_the_grid_around_it() -> None:
    robot = RobotConfig()
    shares = np.array([[0.3, -0.1], [1.0, 1.0], [0.0, 0.0], [7.0, -9.0]])
    weights = grid_weights(shares, robot)
    assert weights.shape == (4, 45)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    mean = weights @ commands_of(robot)
    assert mean == pytest.approx(np.clip(shares, (0, -1), (1, 1)) * (robot.v_max_mps, robot.w_max_radps), abs=1e-6)
    assert (weights[1:] > 0).sum() == 3
