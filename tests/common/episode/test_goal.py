import math

import numpy as np
import pytest

from readygo.common.episode.goal import arrival_yaw_rad, goal_pose
from readygo.common.messages import EpisodeKey, Scenario, Split
from tests.services.evaluator.conftest import hall

BEHIND_WALL = (10.0, 1.0)


def test_robot_arrives_as_the_path_comes_around_the_corner():
    assert arrival_yaw_rad(hall(), 0.3, (1.0, 1.0), (6.0, 1.0)) == pytest.approx(0.0, abs=0.05)
    assert arrival_yaw_rad(hall(), 0.3, (1.0, 1.0), BEHIND_WALL) < -0.5


def test_without_a_path_it_arrives_along_the_straight_line():
    assert arrival_yaw_rad(hall(), 3.0, (1.0, 1.0), (4.0, 4.0)) == pytest.approx(math.radians(45.0))
    for goal in ((1.0, 400.0), (1.0, -400.0)):
        assert arrival_yaw_rad(hall(), 0.3, (1.0, 1.0), goal) == math.copysign(math.pi / 2, goal[1])


def test_pose_is_at_the_goal():
    scenario = Scenario(
        episode=EpisodeKey(seed=0, split=Split.TEST, index=0),
        start_xyyaw=np.array([1.0, 1.0, 2.0]),
        goal_xy_m=np.array(BEHIND_WALL),
        humans=(),
    )
    x_m, y_m, yaw_rad = goal_pose(scenario, hall(), 0.3)
    assert (x_m, y_m) == BEHIND_WALL
    assert yaw_rad == arrival_yaw_rad(hall(), 0.3, (1.0, 1.0), BEHIND_WALL)
