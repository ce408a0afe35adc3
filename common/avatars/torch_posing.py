"""Posing humans with torch, many at once, on the device that holds the tensors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from readygo.common.avatars import SMPL_PARENTS, Avatar

NEWTON_STEPS = 16
"""Steps from sqrt(3) times the Frobenius norm, an upper bound, to the largest eigenvalue in float64."""
_LEVELS = ((1, 4), (4, 7), (7, 10), (10, 15), (15, 18), (18, 20), (20, 22), (22, 24))
"""First joint and end of the joints whose parents stand before them, level by level of the tree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Skeletons:
    """Joints of A avatars, float64."""

    tpose_m: Tensor
    """Joints in the T-pose [m], shape (A, 24, 3)."""
    canonical_m: Tensor
    """Joints in the canonical pose [m], shape (A, 24, 3)."""
    R_tpose_canonical: Tensor
    """Rotations from canonical to T-pose coordinates, shape (A, 24, 3, 3)."""
    parents: Tensor
    """Parent of each joint, int64, shape (24,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Skin:
    """What moves the N Gaussians of an avatar, float32."""

    means_m: Tensor
    """Canonical means [m], shape (N, 3)."""
    quats_wxyz: Tensor
    """Canonical rotations, shape (N, 4)."""
    joint: Tensor
    """Joints, int64, shape (N, 4)."""
    weight: Tensor
    """Their weights, shape (N, 4)."""


def load_skeletons(avatars: Sequence[Avatar], device: torch.device | str) -> Skeletons:
    """The avatars' skeletons on a device."""

    def stack_rows(name: str, *shape: int) -> Tensor:
        arrays = [getattr(avatar, name).astype(np.float64) for avatar in avatars]
        return torch.from_numpy(np.stack(arrays) if arrays else np.zeros((0, *shape))).to(device)

    return Skeletons(
        tpose_m=stack_rows("joints_tpose_m", 24, 3),
        canonical_m=stack_rows("joints_canonical_m", 24, 3),
        R_tpose_canonical=stack_rows("R_tpose_canonical", 24, 3, 3),
        parents=torch.tensor(SMPL_PARENTS.astype(np.int64), device=device),
    )


def load_skin(avatar: Avatar, device: torch.device | str) -> Skin:
    """An avatar's Gaussians and their joints on a device."""
    return Skin(
        means_m=torch.tensor(avatar.cloud.means_m, device=device),
        quats_wxyz=torch.tensor(avatar.cloud.quats_wxyz, device=device),
        joint=torch.tensor(avatar.lbs_index.astype(np.int64), device=device),
        weight=torch.tensor(avatar.lbs_weight, device=device),
    )


def joint_transforms(skeletons: Skeletons, avatar: Tensor, root_m: Tensor, pose_axis_angle: Tensor) -> Tensor:
    """Transforms that carry canonical coordinates to the z-up world, as `readygo.common.avatars.joint_transforms` does.

    Args:
        skeletons: Skeletons of all avatars.
        avatar: Which avatar each human is, int64, shape (P,).
        root_m: Pelvises in the z-up world [m], float64, shape (P, 3).
        pose_axis_angle: Parent-relative rotations [rad], float64, shape (P, 24, 3).

    Returns:
        Float64, shape (P, 24, 3, 4).

    Source: Loper et al., SMPL: A Skinned Multi-Person Linear Model, 2015, section 3.
    """
    return turned_joints(skeletons, avatar, root_m, rotation_matrices(pose_axis_angle))


def turned_joints(skeletons: Skeletons, avatar: Tensor, root_m: Tensor, R: Tensor) -> Tensor:
    """What `joint_transforms` answers, of parent-relative rotation matrices, shape (P, 24, 3, 3)."""
    tpose = skeletons.tpose_m[avatar]
    G, P = _globals(R, tpose, root_m, skeletons.parents)
    A = G @ skeletons.R_tpose_canonical[avatar]
    shift = P - (A @ skeletons.canonical_m[avatar][..., None])[..., 0]
    return torch.cat([A, shift[..., None]], dim=-1)


def _globals(R: Tensor, tpose_m: Tensor, root_m: Tensor, parents: Tensor) -> tuple[Tensor, Tensor]:
    """Global rotations (P, 24, 3, 3) and positions (P, 24, 3) of all joints in the z-up world, level by level."""
    G, P = torch.empty_like(R), torch.empty_like(tpose_m)
    # (x, y, z)_zup = (x, -z, y)_yup
    G[:, 0] = torch.stack([R[:, 0, 0], -R[:, 0, 2], R[:, 0, 1]], dim=1)
    P[:, 0] = root_m
    for first, end in _LEVELS:
        parent = parents[first:end]
        G_parent = G[:, parent]
        G[:, first:end] = G_parent @ R[:, first:end]
        offset = tpose_m[:, first:end] - tpose_m[:, parent]
        P[:, first:end] = P[:, parent] + (G_parent @ offset[..., None])[..., 0]
    return G, P


def rotation_matrices(axis_angle: Tensor) -> Tensor:
    """Rodrigues' rotation matrices of axis-angle vectors [rad], (..., 3) -> (..., 3, 3)."""
    x, y, z = axis_angle.unbind(-1)
    angle = axis_angle.norm(dim=-1)
    small = angle < 1e-8
    safe = torch.where(small, torch.ones_like(angle), angle)
    s = torch.where(small, torch.ones_like(angle), torch.sin(safe) / safe)
    c = torch.where(small, torch.full_like(angle, 0.5), 2.0 * torch.sin(0.5 * safe) ** 2 / safe**2)
    rows = [
        1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y,
        c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x,
        c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).reshape(*axis_angle.shape[:-1], 3, 3)


def pose_gaussians(skin: Skin, A: Tensor) -> tuple[Tensor, Tensor]:
    """Means and rotations of an avatar's Gaussians for P humans, as `readygo.common.avatars.pose_avatar` makes them.

    Args:
        skin: The avatar.
        A: Joint transforms to the wanted frame, shape (P, 24, 3, 4); its precision is the result's.

    Returns:
        Means [m], shape (P, N, 3), and unit quaternions, w not negative before the Gaussian's own, shape (P, N, 4).
    """
    weight = skin.weight.to(A.dtype)
    M = sum(weight[None, :, k, None, None] * A[:, skin.joint[:, k]] for k in range(4))
    assert isinstance(M, Tensor)
    means = (M[..., :3] @ skin.means_m.to(A.dtype)[..., None])[..., 0] + M[..., 3]
    quats = quat_multiply(nearest_quat(M[..., :3]), skin.quats_wxyz.to(A.dtype)[None])
    return means, quats


def nearest_quat(M: Tensor) -> Tensor:
    """Quaternions wxyz (w >= 0) of the rotations nearest to matrices in the Frobenius norm, (..., 3, 3) -> (..., 4).

    The quaternion is the eigenvector of the largest eigenvalue of a symmetric 4x4 matrix N. With the characteristic
    polynomial p, that eigenvalue is found by Newton's method from above, and p(N) / (N - eigenvalue) is a multiple of
    the eigenvector's outer product. Reflections, which iterations for the polar factor keep, become rotations here.

    Sources: Horn, Closed-form solution of absolute orientation using unit quaternions, 1987; Theobald, Rapid
    calculation of RMSDs using a quaternion-based characteristic polynomial, 2005.
    """
    dtype, M = M.dtype, M.double()
    squares = (M * M).sum((-2, -1))
    gram = M.mT @ M
    c2, c1, c0 = -2.0 * squares, -8.0 * torch.linalg.det(M), 2.0 * (gram * gram).sum((-2, -1)) - squares**2
    largest = (3.0 * squares).sqrt()
    for _ in range(NEWTON_STEPS):
        slope = 4.0 * largest**3 + 2.0 * c2 * largest + c1
        value = ((largest * largest + c2) * largest + c1) * largest + c0
        largest = largest - torch.where(slope > 0, value / slope.clamp(min=1e-30), 0.0)
    N = _horn_matrix(M)
    square = N @ N
    a, b = largest[..., None, None], c2[..., None, None]
    outer = (square + a * N + (a * a + b) * torch.eye(4, dtype=N.dtype, device=N.device)) @ N
    outer = outer + (largest**3 + c2 * largest + c1)[..., None, None] * torch.eye(4, dtype=N.dtype, device=N.device)
    best = outer.diagonal(dim1=-2, dim2=-1).argmax(dim=-1)
    q = torch.take_along_dim(outer, best[..., None, None], dim=-2)[..., 0, :]
    q = q / q.norm(dim=-1, keepdim=True)
    return torch.where(q[..., :1] < 0, -q, q).to(dtype)


def _horn_matrix(M: Tensor) -> Tensor:
    """The matrix N with q^T N q = trace(R(q)^T M), (..., 3, 3) -> (..., 4, 4)."""
    xx, yy, zz = M[..., 0, 0], M[..., 1, 1], M[..., 2, 2]
    xy, xz, yz = M[..., 0, 1] + M[..., 1, 0], M[..., 0, 2] + M[..., 2, 0], M[..., 1, 2] + M[..., 2, 1]
    wx, wy, wz = M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]
    rows = [
        xx + yy + zz, wx, wy, wz,
        wx, xx - yy - zz, xy, xz,
        wy, xy, yy - xx - zz, yz,
        wz, xz, yz, zz - xx - yy,
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).reshape(*M.shape[:-2], 4, 4)


def quat_multiply(p: Tensor, q: Tensor) -> Tensor:
    """Hamilton products p q of quaternions wxyz, (..., 4)."""
    pw, px, py, pz = p.unbind(-1)
    qw, qx, qy, qz = q.unbind(-1)
    return torch.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        dim=-1,
    )
