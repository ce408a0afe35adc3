import dataclasses

import pytest

from readygo.common.errors import ConfigError
from readygo.common.robot.ranges import RobotRanges
from readygo.common.state_simulation.world import ObservationConfig
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world
from readygo.runs.state_world import goal_distances, state_driver, state_world
from tests.common.state_policy.state_policies import make_state_policy


def test_world_has_the_numbers_of_the_run() -> None:
    world = evaluation_world("embedded", RunConfig(), avatars=None, seed=0)
    made, config = state_world(world, ObservationConfig()), world.config
    assert made.robot.v_max_mps == config.robot.v_max_mps
    assert made.contact_m == config.robot.radius_m + config.episode.human_radius_m
    assert made.step_limit == config.robot.clock.steps(config.episode.time_limit_s)
    rows, columns = world.scene.maps.robot.occupied.shape
    assert goal_distances(world).to_goal_cm((0.0, 0.0)).shape == (-(-rows // 2), -(-columns // 2))


def test_robots_of_ranges_are_refused() -> None:
    ranged = dataclasses.replace(RunConfig().robot, ranges=RobotRanges(radius_m=(0.2, 0.3)))
    world = evaluation_world("embedded", dataclasses.replace(RunConfig(), robot=ranged), avatars=None, seed=0)
    with pytest.raises(ConfigError, match="ranges"):
        state_world(world, ObservationConfig())
    with pytest.raises(ConfigError, match="ranges"):
        state_driver(world, make_state_policy())


def test_driver_holds_commands_as_long_as_its_policy_did() -> None:
    world = evaluation_world("embedded", RunConfig(), avatars=None, seed=0)
    assert state_driver(world, make_state_policy(hold_s=0.4)).hold_steps == 8
