"""Forward kinematics of the SMPL-24 skeleton, from a motion's row to joint transforms in the z-up world.

Legend: G = global rotation of a joint, P = its position, J = its rest position (c: canonical pose, t: T-pose).
The arithmetic is scalar and in a fixed order, so that its results do not depend on the machine's vector width.
"""

import math

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.avatars.avatar import SMPL_PARENTS, Avatar
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages.motion import Motion

_PARENTS = tuple(int(parent) for parent in SMPL_PARENTS)


def joint_transforms(avatar: Avatar, root_m: npt.ArrayLike, pose_axis_angle: npt.ArrayLike) -> Float64Array:
    """Transforms that carry canonical SMPL coordinates to the z-up world, one per joint.

    A_j = [G_j R_j | P_j - G_j R_j J_c,j], with R_j from the canonical pose to the T-pose and P by forward kinematics
    from the T-pose's joints. A point that joints j move by w_j goes to sum_j w_j (A_j @ [p, 1]).

    Args:
        avatar: Whose skeleton.
        root_m: Pelvis in the z-up world [m], shape (3,).
        pose_axis_angle: Parent-relative rotations [rad] as in `Motion`, shape (24, 3).

    Returns:
        Shape (24, 3, 4).

    Source: Loper et al., SMPL: A Skinned Multi-Person Linear Model, 2015, section 3.
    """
    root = np.ascontiguousarray(root_m, dtype=np.float64)
    pose = np.ascontiguousarray(pose_axis_angle, dtype=np.float64)
    if root.shape != (3,) or pose.shape != (24, 3):
        raise ValueError(f"root_m must be (3,) and pose_axis_angle (24, 3), got {root.shape} and {pose.shape}.")
    A = np.empty((24, 3, 4))
    fill_joint_transforms(root, pose, avatar.joints_tpose_m, avatar.joints_canonical_m, avatar.R_tpose_canonical, A)
    return A


def joint_positions(avatar: Avatar, motion: Motion) -> Float64Array:
    """Where the joints are, in the z-up world [m], shape (T, 24, 3)."""
    positions = np.empty((len(motion.root_m), 24, 3))
    rotations = np.empty((24, 3, 3))
    root, pose = motion.root_m.astype(np.float64), motion.pose_axis_angle.astype(np.float64)
    for row in range(len(root)):
        fill_globals(root[row], pose[row], avatar.joints_tpose_m, rotations, positions[row])
    return positions


@kernel_with_cache
def fill_globals(
    root: Float64Array, pose: Float64Array, joints_tpose: Float32Array, G: Float64Array, P: Float64Array
) -> None:
    """Write global rotations G (24, 3, 3) and positions P (24, 3) of all joints in the z-up world."""
    R = np.empty((3, 3))
    for j in range(24):
        _fill_rotation(pose[j, 0], pose[j, 1], pose[j, 2], R)
        parent = _PARENTS[j]
        if parent < 0:
            for k in range(3):
                # (x, y, z)_zup = (x, -z, y)_yup
                G[j, 0, k] = R[0, k]
                G[j, 1, k] = -R[2, k]
                G[j, 2, k] = R[1, k]
                P[j, k] = root[k]
            continue
        dx = float(joints_tpose[j, 0]) - float(joints_tpose[parent, 0])
        dy = float(joints_tpose[j, 1]) - float(joints_tpose[parent, 1])
        dz = float(joints_tpose[j, 2]) - float(joints_tpose[parent, 2])
        for i in range(3):
            g0, g1, g2 = G[parent, i, 0], G[parent, i, 1], G[parent, i, 2]
            P[j, i] = P[parent, i] + (g0 * dx + g1 * dy + g2 * dz)
            for k in range(3):
                G[j, i, k] = g0 * R[0, k] + g1 * R[1, k] + g2 * R[2, k]


@kernel_with_cache
def fill_joint_transforms(
    root: Float64Array,
    pose: Float64Array,
    joints_tpose: Float32Array,
    joints_canonical: Float32Array,
    R_tpose_canonical: Float32Array,
    A: Float64Array,
) -> None:
    """Write `joint_transforms` into A (24, 3, 4), for callers that are compiled themselves."""
    G = np.empty((24, 3, 3))
    P = np.empty((24, 3))
    fill_globals(root, pose, joints_tpose, G, P)
    for j in range(24):
        for i in range(3):
            shift = 0.0
            for k in range(3):
                value = (
                    G[j, i, 0] * float(R_tpose_canonical[j, 0, k])
                    + G[j, i, 1] * float(R_tpose_canonical[j, 1, k])
                    + G[j, i, 2] * float(R_tpose_canonical[j, 2, k])
                )
                A[j, i, k] = value
                shift += value * float(joints_canonical[j, k])
            A[j, i, 3] = P[j, i] - shift


@kernel_with_cache
def posed_point(
    A: Float64Array,
    points: Float64Array,
    lbs_index: UInt8Array,
    lbs_weight: Float32Array,
    n: int,
) -> tuple[float, float, float]:
    """Where joints with transforms A (24, 3, 4) carry the canonical point n, for callers that are compiled."""
    px, py, pz = points[n, 0], points[n, 1], points[n, 2]
    x, y, z = 0.0, 0.0, 0.0
    for k in range(4):
        w = float(lbs_weight[n, k])
        # Most points hang on two joints.
        if w == 0.0:
            continue
        j = lbs_index[n, k]
        x += w * (A[j, 0, 0] * px + A[j, 0, 1] * py + A[j, 0, 2] * pz + A[j, 0, 3])
        y += w * (A[j, 1, 0] * px + A[j, 1, 1] * py + A[j, 1, 2] * pz + A[j, 1, 3])
        z += w * (A[j, 2, 0] * px + A[j, 2, 1] * py + A[j, 2, 2] * pz + A[j, 2, 3])
    return x, y, z


@kernel_with_cache
def _fill_rotation(x: float, y: float, z: float, R: Float64Array) -> None:
    """Write Rodrigues' rotation matrix of the axis-angle vector (x, y, z) [rad] into R."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-8:
        s, c = 1.0, 0.5
    else:
        half = math.sin(0.5 * angle)
        s = math.sin(angle) / angle
        c = 2.0 * half * half / (angle * angle)
    R[0, 0] = 1.0 - c * (y * y + z * z)
    R[0, 1] = c * x * y - s * z
    R[0, 2] = c * x * z + s * y
    R[1, 0] = c * x * y + s * z
    R[1, 1] = 1.0 - c * (x * x + z * z)
    R[1, 2] = c * y * z - s * x
    R[2, 0] = c * x * z - s * y
    R[2, 1] = c * y * z + s * x
    R[2, 2] = 1.0 - c * (x * x + y * y)
