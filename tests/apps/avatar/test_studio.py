import numpy as np
import pytest

from readygo.apps.avatar.studio import Framing, look_at, standing_pose, stride_pose, turntable
from readygo.common.avatars import load_avatars


def test_camera_looks_at_its_target_upright():
    T = look_at((1.0, -3.0, 1.5), (1.0, 1.0, 0.5))
    ahead = np.linalg.inv(T) @ (1.0, 1.0, 0.5, 1.0)
    assert ahead[:2] == pytest.approx((0.0, 0.0), abs=1e-12)
    assert ahead[2] == pytest.approx(np.sqrt(17.0))
    assert T[:3, 0] == pytest.approx((1.0, 0.0, 0.0))
    assert T[2, 1] < 0
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_framing_has_its_principal_point_in_the_middle():
    K = Framing(height_px=400, width_px=300, focal_px=800.0).K_px
    assert K.tolist() == [[800.0, 0.0, 150.0], [0.0, 800.0, 200.0], [0.0, 0.0, 1.0]]


def test_front_and_back_differ() -> None:
    avatar = next(iter(load_avatars().values()))
    sheet = turntable(avatar, [standing_pose()]).astype(int)
    front, back = sheet[:, :240], sheet[:, 4 * 240 : 5 * 240]
    assert np.abs(front - back).max(axis=2).mean() > 1.0


def test_stride_moves_the_legs_apart() -> None:
    assert np.abs(stride_pose() - standing_pose())[[1, 2]].max() > 0.2
