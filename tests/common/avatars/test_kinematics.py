from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_positions, joint_transforms, load_avatars, pose_avatar
from readygo.common.frames import matrix_from_axis_angle, zup_from_yup
from readygo.common.messages import Motion


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    return next(iter(load_avatars().values()))


def random_pose(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, 3), rng.normal(scale=0.8, size=(24, 3))


def plain_transforms(avatar: Avatar, root_m: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The formula of `joint_transforms` in homogeneous matrices, composed joint by joint."""
    R = matrix_from_axis_angle(pose)
    T_world_joint = np.tile(np.eye(4), (24, 1, 1))
    A = np.empty((24, 3, 4))
    for j in range(24):
        parent = SMPL_PARENTS[j]
        local = np.eye(4)
        local[:3, :3] = R[j]
        if parent < 0:
            local[:3, :3] = zup_from_yup(R[j].T).T
            local[:3, 3] = root_m
            T_world_joint[j] = local
        else:
            local[:3, 3] = avatar.joints_tpose_m[j] - avatar.joints_tpose_m[parent]
            T_world_joint[j] = T_world_joint[parent] @ local
        rest = np.eye(4)
        rest[:3, :3] = avatar.R_tpose_canonical[j]
        rest[:3, 3] = -avatar.R_tpose_canonical[j] @ avatar.joints_canonical_m[j]
        A[j] = (T_world_joint[j] @ rest)[:3]
    return A


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_transforms_equal_the_chain_of_homogeneous_matrices(seed: int) -> None:
    avatar = next(iter(load_avatars().values()))
    root, pose = random_pose(seed)
    np.testing.assert_allclose(joint_transforms(avatar, root, pose), plain_transforms(avatar, root, pose), atol=2e-6)


def test_canonical_joints_land_on_joint_positions(avatar: Avatar) -> None:
    root, pose = random_pose(1)
    A = joint_transforms(avatar, root, pose)
    landed = np.einsum("jik,jk->ji", A[:, :, :3], avatar.joints_canonical_m) + A[:, :, 3]
    motion = Motion(root_m=root[None].astype(np.float32), pose_axis_angle=pose[None].astype(np.float32))
    np.testing.assert_allclose(joint_positions(avatar, motion)[0], landed, atol=1e-5)
    np.testing.assert_allclose(landed[0], root, atol=1e-6)


def test_bones_keep_their_length(avatar: Avatar) -> None:
    root, pose = random_pose(2)
    motion = Motion(root_m=root[None].astype(np.float32), pose_axis_angle=pose[None].astype(np.float32))
    p = joint_positions(avatar, motion)[0]
    want = np.linalg.norm(avatar.joints_tpose_m[1:] - avatar.joints_tpose_m[SMPL_PARENTS[1:]], axis=1)
    np.testing.assert_allclose(np.linalg.norm(p[1:] - p[SMPL_PARENTS[1:]], axis=1), want, atol=1e-5)


def test_zero_pose_stands_upright_and_faces_minus_y(avatar: Avatar) -> None:
    A = joint_transforms(avatar, (0.0, 0.0, avatar.joints_tpose_m[0, 1]), np.zeros((24, 3)))
    np.testing.assert_allclose(A[0, :, :3] @ (0, 1, 0), (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(A[0, :, :3] @ (0, 0, 1), (0, -1, 0), atol=1e-6)


def test_tiny_angles_are_smooth(avatar: Avatar) -> None:
    pose = np.zeros((24, 3))
    rest = joint_transforms(avatar, np.zeros(3), pose)
    for angle in (1e-12, 1e-9, 2e-8, 1e-6):
        pose[18, 1] = angle
        moved = joint_transforms(avatar, np.zeros(3), pose)
        assert np.abs(moved - rest).max() < 3 * angle + 1e-15


def test_wrong_shapes_are_refused(avatar: Avatar) -> None:
    with pytest.raises(ValueError, match="pose_axis_angle"):
        joint_transforms(avatar, np.zeros(3), np.zeros((22, 3)))


def test_recorded_walk_is_upright_on_the_floor_and_faces_its_path(shared_data: Path) -> None:
    avatar = load_avatars(shared_data / "avatars" / "m1_casual.npz")["m1_casual"]
    with np.load(shared_data / "motion" / "walk_s_curve_1p2mps.npz") as data:
        motion = Motion(root_m=data["root_m"], pose_axis_angle=data["pose_axis_angle"])
    joints = joint_positions(avatar, motion)
    assert np.all(joints[:, 15, 2] - joints[:, 0, 2] > 0.6)
    for step in (20, 90, 160):
        z = pose_avatar(avatar, motion.root_m[step], motion.pose_axis_angle[step]).means_m[:, 2]
        assert abs(z.min()) < 0.012
        across = joints[step, 1] - joints[step, 2]
        facing = np.array([across[1], -across[0]]) / np.hypot(*across[:2])
        heading = motion.root_m[step + 1, :2] - motion.root_m[step - 1, :2]
        assert facing @ heading / np.linalg.norm(heading) > 0.97
