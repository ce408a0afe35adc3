import math

import numpy as np
import pytest

from readygo.common.dataset.poses import pose_of, pose_xyzyaw
from readygo.common.frames import matrix_from_quat


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, -3.1, 3.3, 6.0, -40.0])
def test_pose_turns_about_z_and_comes_back_wrapped(yaw_rad: float) -> None:
    pose = pose_of(1.0, -2.0, 0.5, yaw_rad)
    q = pose.orientation
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    expected = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert matrix_from_quat(np.array([q.w, q.x, q.y, q.z])) == pytest.approx(expected, abs=1e-12)
    *place, found_rad = pose_xyzyaw(pose)
    assert place == [1.0, -2.0, 0.5]
    assert abs(found_rad) <= math.pi
    assert math.remainder(found_rad - yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-12)
