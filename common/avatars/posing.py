"""Posing an avatar's Gaussians: the plain reference that fast implementations are compared with."""

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.kinematics import joint_transforms
from readygo.common.frames import quat_from_matrix, quat_multiply
from readygo.common.gaussians import GaussianCloud


def pose_avatar(avatar: Avatar, root_m: npt.ArrayLike, pose_axis_angle: npt.ArrayLike) -> GaussianCloud:
    """The avatar's Gaussians in one pose, in the z-up world.

    Linear blend skinning moves the means; each Gaussian's rotation is the nearest rotation of the blended 3x3 times
    its own, so that scales stay. Spherical harmonics above degree 0 are not rotated.

    Args:
        avatar: Who.
        root_m: Pelvis in the z-up world [m], shape (3,).
        pose_axis_angle: Parent-relative rotations [rad] as in `Motion`, shape (24, 3).

    Returns:
        Gaussians [m] in the z-up world.
    """
    A = joint_transforms(avatar, root_m, pose_axis_angle)
    M = np.einsum("nk,nkij->nij", avatar.lbs_weight.astype(np.float64), A[avatar.lbs_index])
    means = np.einsum("nij,nj->ni", M[:, :, :3], avatar.cloud.means_m) + M[:, :, 3]
    quats = quat_multiply(quat_from_matrix(nearest_rotation(M[:, :, :3])), avatar.cloud.quats_wxyz)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=quats.astype(np.float32),
        scales_m=avatar.cloud.scales_m,
        opacities=avatar.cloud.opacities,
        sh=avatar.cloud.sh,
    )


def nearest_rotation(M: Float64Array) -> Float64Array:
    """The rotation matrices nearest to M in the Frobenius norm, shape (..., 3, 3).

    Source: Kabsch, A solution for the best rotation to relate two sets of vectors, 1976.
    """
    U, _, Vt = np.linalg.svd(M)
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    rotation: Float64Array = U @ Vt
    return rotation
