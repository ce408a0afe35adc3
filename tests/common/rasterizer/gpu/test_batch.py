import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.rasterizer.cpu.rasterizer import PosedPerson
from readygo.common.rasterizer.gpu.batch import make_batch

POSES = np.tile(np.eye(4), (2, 1, 1))


def test_cameras_may_see_different_numbers_of_people(person) -> None:
    batch = make_batch(POSES, [[], [person(1.0, 2.0), person(3.0, 4.0, avatar=1)]], 2, "cpu")
    assert batch.avatar.tolist() == [[-1, -1], [0, 1]]
    assert batch.root_m[1, 1].tolist() == [3.0, 4.0, 1.0]
    assert batch.part(1, 2).avatar.tolist() == [[0, 1]]


@pytest.mark.parametrize("poses", [np.full((2, 4, 4), np.nan), np.eye(4), np.zeros((2, 3, 4))])
def test_bad_camera_poses_are_refused(poses) -> None:
    with pytest.raises(ValueError, match="T_world_camera"):
        make_batch(poses, [[], []], 0, "cpu")


def test_people_must_be_given_per_camera(person) -> None:
    with pytest.raises(ValueError, match="one sequence per camera, got 1 for 2"):
        make_batch(POSES, [[person(0, 0)]], 1, "cpu")


def test_unknown_avatar_and_bad_pose_are_refused(person) -> None:
    with pytest.raises(ValueError, match=r"avatar must be 0\.\.0, got 1"):
        make_batch(POSES, [[], [person(0, 0, avatar=1)]], 1, "cpu")
    bad = PosedPerson(avatar=0, root_m=np.array([np.nan, 0, 0]), pose_axis_angle=np.zeros((24, 3)))
    with pytest.raises(ValueError, match="finite"):
        make_batch(POSES, [[], [bad]], 1, "cpu")
