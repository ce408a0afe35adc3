import math

import numpy as np
import pytest

from readygo.common.frames import goal_in_robot_frame, goals_in_robot_frames


def test_goal_in_robot_frame_is_forward_and_left() -> None:
    assert goal_in_robot_frame(1.0, 1.0, math.pi / 2, np.array([0.0, 3.0])) == pytest.approx((2.0, 1.0))
    assert goal_in_robot_frame(1.0, 1.0, 0.0, (3.0, 0.0)) == (2.0, -1.0)


def test_many_goals_are_as_each_alone() -> None:
    rng = np.random.default_rng(0)
    xyyaw, goals_xy_m = rng.normal(size=(20, 3)) * 3, rng.normal(size=(20, 2)) * 5
    alone = [
        goal_in_robot_frame(x_m, y_m, yaw_rad, goal)
        for (x_m, y_m, yaw_rad), goal in zip(xyyaw.tolist(), goals_xy_m, strict=True)
    ]
    np.testing.assert_allclose(goals_in_robot_frames(xyyaw, goals_xy_m), alone, atol=1e-14)
