import numpy as np
import pytest

from common.avatars import Avatar, avatar_paths, load_avatars, pose_avatar

AVATARS = load_avatars()


@pytest.fixture(params=sorted(AVATARS))
def avatar(request: pytest.FixtureRequest) -> Avatar:
    return AVATARS[request.param]


def test_there_are_at_least_four_and_their_files_carry_their_names() -> None:
    assert len(AVATARS) >= 4
    assert [path.stem for path in avatar_paths(None)] == list(AVATARS)


def test_avatar_is_small_free_and_complete(avatar: Avatar) -> None:
    assert 30_000 <= len(avatar.cloud) <= 60_000
    assert "CC0" in avatar.license


def test_soles_are_on_the_ground_and_the_head_at_its_height(avatar: Avatar) -> None:
    y = avatar.cloud.means_m[:, 1]
    assert abs(y.min()) < 0.003
    assert 0.0 <= y.max() - avatar.height_m < 0.08


def test_body_is_symmetric_and_looks_along_z(avatar: Avatar) -> None:
    joints = avatar.joints_canonical_m
    left, right = joints[[1, 4, 7, 16, 18, 20]], joints[[2, 5, 8, 17, 19, 21]]
    np.testing.assert_allclose(left, right * (-1, 1, 1), atol=0.005)
    assert np.all(left[:, 0] > 0.05)
    assert np.all(joints[[10, 11], 2] - joints[[7, 8], 2] > 0.1)


def test_joint_rotations_are_proper_and_feet_keep_theirs(avatar: Avatar) -> None:
    R = avatar.R_tpose_canonical.astype(np.float64)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (24, 1, 1)), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-5)
    np.testing.assert_allclose(R[[0, 3, 6, 7, 8, 9, 10, 11, 12, 15]], np.tile(np.eye(3), (10, 1, 1)), atol=1e-6)


def test_zero_pose_is_a_t_with_the_arms_along_x(avatar: Avatar) -> None:
    arm = avatar.joints_tpose_m[20] - avatar.joints_tpose_m[16]
    assert arm[0] / np.linalg.norm(arm) > 0.99
    assert avatar.joints_tpose_m[7, 1] == pytest.approx(avatar.joints_canonical_m[7, 1], abs=0.02)


def test_standing_person_touches_the_floor_and_is_as_wide_as_a_person(avatar: Avatar) -> None:
    pose = np.zeros((24, 3))
    pose[16], pose[17] = (0, 0, -1.3), (0, 0, 1.3)
    cloud = pose_avatar(avatar, (0.0, 0.0, avatar.joints_tpose_m[0, 1]), pose)
    extent = cloud.means_m.max(axis=0) - cloud.means_m.min(axis=0)
    assert abs(cloud.means_m[:, 2].min()) < 0.02
    assert 0.4 < extent[0] < 0.95
    assert 0.2 < extent[1] < 0.5


def test_each_person_looks_different() -> None:
    tones = np.array([avatar.cloud.sh[:, 0].mean(axis=0) for avatar in AVATARS.values()])
    distance = np.abs(tones[:, None] - tones[None]).max(axis=2)
    assert distance[~np.eye(len(tones), dtype=bool)].min() > 0.02
