import numpy as np
import pytest

from readygo.common.avatars import Avatar, joint_transforms, pose_avatar
from readygo.common.avatars.posing import nearest_rotation
from readygo.common.frames import matrix_from_quat

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.avatars import torch_posing as posing  # noqa: E402


def poses(count: int, spread_rad: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.uniform(-5, 5, size=(count, 3)), spread_rad * rng.normal(size=(count, 24, 3))


def transforms(avatar: Avatar, root: np.ndarray, pose: np.ndarray) -> "torch.Tensor":
    skeletons = posing.load_skeletons([avatar], "cpu")
    humans = torch.zeros(len(root), dtype=torch.int64)
    return posing.joint_transforms(skeletons, humans, torch.from_numpy(root), torch.from_numpy(pose))


def test_joint_transforms_are_those_of_the_avatar(avatar) -> None:
    root, pose = poses(4)
    pose[1] = 0.0
    A = transforms(avatar, root, pose).numpy()
    for k in range(4):
        np.testing.assert_allclose(A[k], joint_transforms(avatar, root[k], pose[k]), atol=1e-12)


def test_humans_posed_together_are_as_pose_avatar_makes_them(avatar) -> None:
    root, pose = poses(3)
    A = transforms(avatar, root, pose).float()
    means, quats = posing.pose_gaussians(posing.load_skin(avatar, "cpu"), A)
    for k in range(3):
        wanted = pose_avatar(avatar, root[k], pose[k])
        np.testing.assert_allclose(means[k].numpy(), wanted.means_m, atol=1e-5)
        sign = np.sign((quats[k].numpy() * wanted.quats_wxyz).sum(axis=1, keepdims=True))
        np.testing.assert_allclose(sign * quats[k].numpy(), wanted.quats_wxyz, atol=1e-5)


def quat(angle_rad: float, axis: int) -> "torch.Tensor":
    q = torch.zeros(4, dtype=torch.float64)
    q[0], q[1 + axis] = np.cos(angle_rad / 2), np.sin(angle_rad / 2)
    return q


def test_blend_of_two_far_rotations_becomes_the_rotation_halfway() -> None:
    turns = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], dtype=torch.float64)
    blend = posing.rotation_matrices(turns).mean(dim=0)
    torch.testing.assert_close(posing.nearest_quat(blend), quat(1.0, 2))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_have_quaternions(axis: int) -> None:
    turn = torch.zeros(3, dtype=torch.float64)
    turn[axis] = np.pi
    q = posing.nearest_quat(posing.rotation_matrices(turn))
    torch.testing.assert_close(q.abs(), quat(np.pi, axis).abs(), atol=1e-9, rtol=0)


def test_nearest_rotation_is_that_of_the_singular_value_decomposition() -> None:
    M = np.random.default_rng(0).normal(size=(500, 3, 3))
    assert (np.linalg.det(M) < 0).sum() > 100
    R = matrix_from_quat(posing.nearest_quat(torch.from_numpy(M)).numpy())
    np.testing.assert_allclose(R, nearest_rotation(M), atol=1e-6)
