import math

import numpy as np
import pytest

from readygo.common.policy.motion import odometry, own_motion


def test_odometry_of_a_quarter_turn() -> None:
    count = 41
    commands = np.tile(np.array([[1.0, math.pi / 4]], np.float32), (count, 1))
    radius = 4 / math.pi
    assert odometry(commands, 0.05)[-1] == pytest.approx([radius, radius, math.pi / 2], abs=1e-5)
    assert odometry(commands, 0.05)[0].tolist() == [0, 0, 0]
    assert odometry(commands[:1], 0.05).shape == (1, 3)


def test_older_frames_lie_behind_a_robot_that_drove_on() -> None:
    older = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, math.pi / 2]]])
    features = own_motion(older, np.array([[0.0, 2.0, math.pi / 2]]), np.array([[0.5, 0.1]], np.float32))[0]
    assert features == pytest.approx([-2, 0, -math.pi / 2, -1, 0, 0, 0.5, 0.1], abs=1e-6)
