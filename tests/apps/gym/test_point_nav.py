"""The task without Gymnasium."""

import dataclasses
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.gym.point_nav import PointNav, Reward
from readygo.common.episode.conduct import PERSONAL_SPACE_M
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.policy import PolicySpec, save_spec
from readygo.common.robot import CameraConfig, RobotConfig


@pytest.fixture(scope="module")
def task():
    return PointNav(humans=0, image_px=(24, 32), expert=True, reward=Reward(per_second=0.0))


def test_what_is_gained_on_the_way_is_earned_and_success_more(task):
    episode = task.begin(0, itertools.count())
    first_m, earned = episode.reward.left_m, 0.0
    while episode.simulation.outcome is None:
        reward, terminated, truncated = task.advance(episode, task.info(episode)["expert_command"])
        earned += reward
    assert (terminated, truncated) == (True, False)
    assert task.info(episode)["success"]
    assert earned == pytest.approx(first_m - episode.reward.left_m + 10.0)
    assert task.info(episode)["cost_collision"] == 0.0


def test_collision_ends_the_episode_and_is_a_cost(task):
    # Straight on from the first start is a wall.
    episode = task.begin(0, itertools.count())
    ended = False
    while not ended:
        reward, terminated, truncated = task.advance(episode, (1.0, 0.0))
        ended = terminated or truncated
    assert terminated
    assert not task.info(episode)["success"]
    assert task.info(episode)["cost_collision"] == 1.0
    assert reward < -9.0


@pytest.fixture(scope="module")
def hurried(tmp_path_factory):
    """A robot commanded at 10 Hz and simulated at 30 Hz, with 0.5 s for its way, among two people."""
    config = tmp_path_factory.mktemp("run") / "run.toml"
    config.write_text(
        "[episode]\ntime_limit_s = 0.5\n[robot]\ncontrol_hz = 10\ncamera_hz = 15\n"
        "[robot.camera]\nheight_px = 24\nwidth_px = 32\n"
    )
    return PointNav(
        humans=2, config=config, reward=Reward(per_metre=3.0, per_second=-0.4, success=50.0, collision=-70.0)
    )


def test_time_limit_truncates_the_episode_and_earns_nothing_else(hurried):
    episode = hurried.begin(0, itertools.count())
    steps = [hurried.advance(episode, (0.0, 0.0)) for _ in range(15)]
    assert [(terminated, truncated) for _, terminated, truncated in steps] == [(False, False)] * 14 + [(False, True)]
    assert [reward for reward, _, _ in steps] == pytest.approx([-0.4 / 30] * 15)
    info = hurried.info(episode)
    assert (info["outcome"], info["success"], info["cost_collision"]) == ("timeout", False, 0.0)


def test_way_that_is_gained_earns_by_the_metre(hurried):
    episode = hurried.begin(0, itertools.count())
    left_m, earned = episode.reward.left_m, []
    for _ in range(14):
        reward, *_ = hurried.advance(episode, (0.5, 0.2))
        assert reward == pytest.approx(3.0 * (left_m - episode.reward.left_m) - 0.4 / 30)
        left_m = episode.reward.left_m
        earned.append(reward)
    assert len({round(reward, 6) for reward in earned}) > 1
    assert hurried.info(episode)["way_left_m"] == left_m


def test_person_nearby_is_an_intrusion_and_distances_are_of_the_nearest(hurried):
    episode = hurried.begin(0, itertools.count())

    def info(*places):
        simulation = SimpleNamespace(x_m=-2.5, y_m=3.0, human_xy_m=places, contact_m=0.7, outcome=None)
        return hurried.info(dataclasses.replace(episode, run=SimpleNamespace(simulation=simulation)))

    far = info((-2.5, 3.0 + 0.7 + PERSONAL_SPACE_M + 0.01), (9.0, 9.0))
    assert (far["cost_intrusion"], far["human_distance_m"]) == (0.0, pytest.approx(0.71 + PERSONAL_SPACE_M))
    near = info((9.0, 9.0), (-2.5 - 0.7 - PERSONAL_SPACE_M + 0.01, 3.0))
    assert (near["cost_intrusion"], near["human_distance_m"]) == (1.0, pytest.approx(0.69 + PERSONAL_SPACE_M))
    assert info()["human_distance_m"] == math.inf
    assert info()["cost_intrusion"] == 0.0


def test_humans_of_the_settings_are_as_many_as_asked_for(hurried):
    indices = itertools.count(5)
    episodes = [hurried.begin(2, indices) for _ in range(3)]
    assert {len(episode.simulation.human_xy_m) for episode in episodes} == {2}
    numbers = [episode.key.index for episode in episodes]
    assert numbers[0] >= 5
    assert numbers == sorted(set(numbers))
    assert {episode.key.seed for episode in episodes} == {2}
    assert episodes[0].expert is None


def test_robots_see_together_what_they_see_alone(task):
    indices = itertools.count()
    episodes = [task.begin(0, indices) for _ in range(2)]
    together = task.observe(episodes)
    assert together["rgb"].shape == (2, 24, 32, 3)
    for k, episode in enumerate(episodes):
        for name, array in task.observe([episode]).items():
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
