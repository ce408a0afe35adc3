import math

import numpy as np
import pytest

from readygo.benchmarks.planning.clearance import gaussian_clearance_m
from readygo.common.avatars import FootprintModel
from readygo.common.maps import FloorMap
from readygo.common.messages import HumanMotion
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.interface import HumanBody
from tests.common.episode.upright import upright_motion
from tests.services.planner.worlds import FRAME, make_avatar

FLOOR = FloorMap(frame=FRAME, height_m=np.zeros((200, 240), np.float32))
AVATAR = make_avatar("mia")
MODEL = FootprintModel.from_avatar(AVATAR)
ROBOT = RobotConfig()


def _body(xy_m):
    return HumanBody(HumanMotion(avatar="mia", motion=upright_motion(xy_m)), AVATAR, MODEL)


def _gap(xyyaw, *people):
    return gaussian_clearance_m(np.array(xyyaw, float), people, FLOOR, ROBOT)


def test_without_humans_there_is_no_clearance_to_tell():
    assert _gap([(0.0, 5.0, 0.0)]) == math.inf


def test_clearance_is_from_the_disc_to_the_body_and_not_to_its_disc():
    """The toy body is 0.4 m wide: its nearest Gaussians are about 0.2 m before its centre."""
    gap_m = _gap([(0.0, 5.0, 0.0)], _body([(1.0, 5.0)]))
    assert gap_m == pytest.approx(1.0 - 0.2 - ROBOT.radius_m, abs=0.05)


def test_the_nearest_moment_of_the_nearest_human_counts():
    robot = [(0.05 * k, 5.0, 0.0) for k in range(60)]
    far, passes = _body([(1.5, 8.0)]), _body([(1.5, 6.2 - 0.005 * k) for k in range(60)])
    gap_m = _gap(robot, far, passes)
    assert gap_m == _gap(robot, passes)
    assert gap_m == pytest.approx(1.05 - 0.2 - ROBOT.radius_m, abs=0.1)


def test_a_robot_within_a_body_has_a_negative_clearance():
    assert _gap([(0.0, 5.0, 0.0)], _body([(0.1, 5.0)])) < 0


def test_what_is_above_the_robot_does_not_count():
    low = RobotConfig(height_m=0.01)
    assert gaussian_clearance_m(np.array([(0.0, 5.0, 0.0)]), [_body([(1.0, 5.0)])], FLOOR, low) > 0.55
