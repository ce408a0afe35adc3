"""Names of SMPL's 24 joints and the shape of its zero pose."""

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars.avatar import SMPL_PARENTS

JOINT_NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
JOINT = {name: number for number, name in enumerate(JOINT_NAMES)}

_LIMBS = (
    ("hip", "knee", (0.087, -0.996, -0.012)),
    ("knee", "ankle", (-0.035, -0.994, -0.104)),
    ("shoulder", "elbow", (0.994, -0.050, -0.099)),
    ("elbow", "wrist", (0.999, 0.035, -0.010)),
    ("wrist", "hand", (0.998, -0.060, -0.020)),
)
"""Bones of the left side and their directions in SMPL's zero pose."""


def rotations_to_tpose(joints_m: Float64Array) -> Float64Array:
    """Rotation of each joint from any upright pose to SMPL's zero pose, shape (24, 3, 3).

    Limbs turn by the smallest rotation that is left after their parent's, so that a limb's twist carries on; trunk,
    head and feet stay, so that soles stay on the ground.

    Args:
        joints_m: Joints, SMPL axes, shape (24, 3).
    """
    R = np.tile(np.eye(3), (24, 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        before = np.eye(3)
        for start, end, direction in _LIMBS:
            if start in ("hip", "shoulder"):
                before = np.eye(3)
            joint = JOINT[f"{side}_{start}"]
            bone = joints_m[JOINT[f"{side}_{end}"]] - joints_m[joint]
            target = np.array(direction) * (sign, 1.0, 1.0)
            R[joint] = before = minimal_rotation(before @ bone, target) @ before
        R[JOINT[f"{side}_hand"]] = R[JOINT[f"{side}_wrist"]]
    return R


def minimal_rotation(first: Float64Array, second: Float64Array) -> Float64Array:
    """The smallest rotation that turns one direction into another; the identity for opposite or zero directions."""
    lengths = np.linalg.norm(first), np.linalg.norm(second)
    if min(lengths) == 0.0:
        return np.eye(3)
    a, b = first / lengths[0], second / lengths[1]
    cosine = float(a @ b)
    if cosine < -0.999:
        return np.eye(3)
    x, y, z = np.cross(a, b)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: Float64Array = np.eye(3) + K + K @ K / (1.0 + cosine)
    return R


def tpose_joints(joints_m: Float64Array, R_tpose_canonical: Float64Array) -> Float64Array:
    """Joints after each bone has turned with its joint, shape (24, 3)."""
    placed = joints_m.copy()
    for joint in range(1, 24):
        parent = int(SMPL_PARENTS[joint])
        placed[joint] = placed[parent] + R_tpose_canonical[parent] @ (joints_m[joint] - joints_m[parent])
    return placed
