"""Skinning agrees with the plain reference, and its derivatives with differences."""

import numpy as np
import pytest
import torch

from readygo.common.avatars import Avatar, joint_transforms, pose_avatar
from readygo.common.avatars.torch_posing import nearest_quat
from readygo.common.frames import matrix_from_quat
from readygo.services.reconstructor.avatars.skinning import skin_gaussians, skin_slopes

STILL = np.tile(np.eye(3, 4, dtype=np.float32), (24, 1, 1))


def _transforms(body: Avatar, seed: int) -> tuple[np.ndarray, np.ndarray]:
    pose = 0.3 * np.random.default_rng(seed).standard_normal((24, 3))
    A = joint_transforms(body, [0.1, 0.2, 0.9], pose)
    return A.astype(np.float32), nearest_quat(torch.from_numpy(A[:, :, :3])).float().numpy(), pose


def test_agrees_with_the_reference(coarse_body: Avatar) -> None:
    A, quats, pose = _transforms(coarse_body, 1)
    cloud = coarse_body.cloud
    skinned = skin_gaussians(
        cloud.means_m, cloud.quats_wxyz, coarse_body.lbs_index, coarse_body.lbs_weight, A, STILL, quats
    )
    reference = pose_avatar(coarse_body, [0.1, 0.2, 0.9], pose)
    np.testing.assert_allclose(skinned.means_m, reference.means_m, atol=1e-5)
    np.testing.assert_allclose(skinned.shaped_m, cloud.means_m, atol=1e-6)
    R, R_reference = matrix_from_quat(skinned.quats_wxyz), matrix_from_quat(reference.quats_wxyz)
    cosines = 0.5 * (np.einsum("nij,nij->n", R, R_reference) - 1.0)
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 3.0


def test_derivatives_are_those_of_the_transforms_and_means(coarse_body: Avatar) -> None:
    A, quats, _ = _transforms(coarse_body, 2)
    B = STILL + 0.02 * np.random.default_rng(3).standard_normal(STILL.shape).astype(np.float32)
    rows = np.arange(0, len(coarse_body.cloud), 7)
    by_means = np.random.default_rng(4).standard_normal((len(rows), 3)).astype(np.float32)
    joint, weight = coarse_body.lbs_index, coarse_body.lbs_weight
    x, a, b = (
        torch.tensor(each, dtype=torch.float64, requires_grad=True) for each in (coarse_body.cloud.means_m, A, B)
    )
    w, index = torch.tensor(weight, dtype=torch.float64), torch.tensor(joint.astype(np.int64))

    def blend(transforms: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        M = (w[..., None, None] * transforms[index]).sum(dim=1)
        return (M[:, :, :3] @ points[..., None])[..., 0] + M[:, :, 3]

    (blend(a, blend(b, x))[rows] * torch.from_numpy(by_means)).sum().backward()
    skinned = skin_gaussians(coarse_body.cloud.means_m, coarse_body.cloud.quats_wxyz, joint, weight, A, B, quats)
    slopes = skin_slopes(
        rows, by_means, np.zeros((len(rows), 4), np.float32), coarse_body.cloud.means_m, joint, weight, A, B, skinned
    )
    assert x.grad is not None
    assert a.grad is not None
    assert b.grad is not None
    np.testing.assert_allclose(slopes.means_m, x.grad[rows].numpy(), atol=1e-4)
    np.testing.assert_allclose(slopes.A, a.grad.numpy(), atol=1e-3)
    np.testing.assert_allclose(slopes.B, b.grad.numpy(), atol=1e-3)


def test_derivatives_by_rotations_turn_back(coarse_body: Avatar) -> None:
    A, quats, _ = _transforms(coarse_body, 5)
    cloud, joint, weight = coarse_body.cloud, coarse_body.lbs_index, coarse_body.lbs_weight
    skinned = skin_gaussians(cloud.means_m, cloud.quats_wxyz, joint, weight, A, STILL, quats)
    rows = np.arange(10)
    slopes = skin_slopes(
        rows, np.zeros((10, 3), np.float32), skinned.quats_wxyz[:10], cloud.means_m, joint, weight, A, STILL, skinned
    )
    np.testing.assert_allclose(slopes.quats_wxyz, cloud.quats_wxyz[:10], atol=1e-5)
    assert slopes.means_m == pytest.approx(0.0)
