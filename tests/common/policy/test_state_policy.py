import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import PolicyError
from readygo.common.policy.state_policy import (
    ACTOR_FILE,
    STATE_POLICY_FILE,
    StatePolicySpec,
    forward,
    hold_steps_of,
    is_state_policy,
    load_state_policy,
)
from readygo.common.robot import RobotConfig
from tests.common.policy.state_policies import make_state_policy, write_state_policy


def test_policy_comes_back_from_its_folder(tmp_path: Path) -> None:
    policy, told = make_state_policy(), np.random.default_rng(1).normal(size=(5, 99)).astype(np.float32)
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
    (folder / STATE_POLICY_FILE).write_text(text.replace("state-policy/1", "state-policy/9"))
    with pytest.raises(PolicyError, match="train it again"):
        load_state_policy(folder)
    (folder / STATE_POLICY_FILE).write_text(text)
    np.savez(folder / ACTOR_FILE, w0=np.zeros((3, 99), np.float32), b0=np.zeros(3, np.float32))
    with pytest.raises(PolicyError, match="do not fit"):
        load_state_policy(folder)
    np.savez(folder / ACTOR_FILE, weights=np.zeros((3, 99), np.float32))
    with pytest.raises(PolicyError, match="layers"):
        load_state_policy(folder)


def test_commands_are_held_for_whole_steps_of_the_robot() -> None:
    robot = dataclasses.replace(RobotConfig(), control_hz=10)
    assert hold_steps_of(robot, 0.2) == 4
    assert StatePolicySpec(robot=robot, scene_hash="", hold_s=0.3).hold_steps == 6
    with pytest.raises(PolicyError, match="multiple"):
        hold_steps_of(robot, 0.25)
