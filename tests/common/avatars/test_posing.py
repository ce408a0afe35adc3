import dataclasses

import numpy as np

from readygo.common.avatars import Avatar, joint_transforms, pose_avatar
from readygo.common.avatars.posing import nearest_rotation
from readygo.common.frames import matrix_from_axis_angle, matrix_from_quat, quat_from_matrix


def test_rigid_turn_of_a_human_turns_every_gaussian(avatar: Avatar) -> None:
    pose = np.zeros((24, 3))
    before = pose_avatar(avatar, np.zeros(3), pose)
    pose[0] = (0.0, np.pi / 2, 0.0)
    after = pose_avatar(avatar, (1.0, 2.0, 0.5), pose)
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(after.means_m, before.means_m @ R.T + (1.0, 2.0, 0.5), atol=1e-5)
    np.testing.assert_allclose(matrix_from_quat(after.quats_wxyz), R @ matrix_from_quat(before.quats_wxyz), atol=1e-5)


def test_nearest_rotation_of_a_rotation_is_itself_and_of_a_mirror_is_proper() -> None:
    R = matrix_from_axis_angle(np.random.default_rng(5).normal(size=(50, 3)))
    np.testing.assert_allclose(nearest_rotation(R * 0.7), R, atol=1e-12)
    mirrored = nearest_rotation(R * np.array([1.0, 1.0, -1.0]))
    np.testing.assert_allclose(np.linalg.det(mirrored), 1.0, atol=1e-12)
    # The axis that gives way is the one that matters least.
    np.testing.assert_allclose(nearest_rotation(R * np.array([1.0, 0.8, -0.1])), R, atol=1e-12)
    assert np.all(quat_from_matrix(R)[:, 0] >= 0)


def test_gaussian_of_two_joints_lies_between_where_each_would_take_it(avatar: Avatar) -> None:
    pose = 0.4 * np.random.default_rng(3).normal(size=(24, 3))
    A = joint_transforms(avatar, (1.0, 2.0, 0.9), pose)
    index = np.tile(np.uint8([4, 5, 0, 0]), (3000, 1))
    weight = np.tile(np.float32([0.75, 0.25, 0.0, 0.0]), (3000, 1))
    posed = pose_avatar(dataclasses.replace(avatar, lbs_index=index, lbs_weight=weight), (1.0, 2.0, 0.9), pose)
    left, right = (avatar.cloud.means_m @ A[joint, :, :3].T + A[joint, :, 3] for joint in (4, 5))
    np.testing.assert_allclose(posed.means_m, 0.75 * left + 0.25 * right, atol=1e-5)
    np.testing.assert_array_equal(posed.scales_m, avatar.cloud.scales_m)
    R = matrix_from_quat(posed.quats_wxyz)
    blend = 0.75 * A[4, :, :3] + 0.25 * A[5, :, :3]
    np.testing.assert_allclose(R, nearest_rotation(blend) @ matrix_from_quat(avatar.cloud.quats_wxyz), atol=1e-5)
