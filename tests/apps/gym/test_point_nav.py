"""The task without Gymnasium."""

import itertools

import numpy as np
import pytest

from readygo.apps.gym.point_nav import PointNav, Reward
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.policy import PolicySpec, save_spec
from readygo.common.robot import CameraConfig, RobotConfig


@pytest.fixture(scope="module")
def task():
    return PointNav(humans=0, image_px=(24, 32), expert=True, reward=Reward(per_second=0.0))


def test_what_is_gained_on_the_way_is_earned_and_success_more(task):
    ride = task.begin(0, itertools.count())
    first_m, earned = ride.left_m, 0.0
    while ride.simulation.outcome is None:
        reward, terminated, truncated = task.advance(ride, task.info(ride)["expert_command"])
        earned += reward
    assert (terminated, truncated) == (True, False)
    assert task.info(ride)["success"]
    assert earned == pytest.approx(first_m - ride.left_m + 10.0)
    assert task.info(ride)["cost_collision"] == 0.0


def test_collision_ends_the_episode_and_is_a_cost(task):
    # Straight on from the first start is a wall.
    ride = task.begin(0, itertools.count())
    ended = False
    while not ended:
        reward, terminated, truncated = task.advance(ride, (1.0, 0.0))
        ended = terminated or truncated
    assert terminated
    assert not task.info(ride)["success"]
    assert task.info(ride)["cost_collision"] == 1.0
    assert reward < -9.0


def test_robots_see_together_what_they_see_alone(task):
    indices = itertools.count()
    rides = [task.begin(0, indices) for _ in range(2)]
    together = task.observe(rides)
    assert together["rgb"].shape == (2, 24, 32, 3)
    for k, ride in enumerate(rides):
        for name, array in task.observe([ride]).items():
            assert np.array_equal(array[0], together[name][k])


def test_arguments_without_sense_are_refused():
    for wrong in ({"humans": 20}, {"split": "mine"}, {"image_px": (0, 4)}):
        with pytest.raises(ConfigError):
            PointNav(**wrong)


def test_robot_and_settings_of_a_policy_are_taken(tmp_path):
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=24, width_px=32))
    save_spec(PolicySpec(robot=robot), tmp_path)
    task = PointNav(humans=1, policy=tmp_path)
    assert task.robot == robot
    with pytest.raises(PolicyError):
        PointNav(policy=tmp_path / "nowhere")


def test_robot_of_ranges_is_refused(tmp_path):
    (tmp_path / "run.toml").write_text("[robot.ranges]\nv_max_mps = [0.5, 1.0]\n")
    with pytest.raises(ConfigError, match="those of one robot: leave"):
        PointNav(config=tmp_path / "run.toml")
