import numpy as np

from readygo.apps.avatar.turntable import standing_pose, stride_pose, turntable
from readygo.common.avatars import load_avatars


def test_front_and_back_differ() -> None:
    avatar = next(iter(load_avatars().values()))
    sheet = turntable(avatar, [standing_pose()]).astype(int)
    front, back = sheet[:, :240], sheet[:, 4 * 240 : 5 * 240]
    assert np.abs(front - back).max(axis=2).mean() > 1.0


def test_stride_moves_the_legs_apart() -> None:
    assert np.abs(stride_pose() - standing_pose())[[1, 2]].max() > 0.2
