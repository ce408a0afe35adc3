"""Bodies of the animator's tests, and what is asked of them."""

import numpy as np

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud

# A shod adult of 1.78 m in SMPL's T-pose: pelvis, left leg, spine and head, left arm; the right side mirrors the left.
CENTRE = {
    0: (0.956, 0.0),
    3: (1.046, -0.031),
    6: (1.125, -0.022),
    9: (1.330, -0.058),
    12: (1.533, 0.009),
    15: (1.629, 0.042),
}
LEFT = {
    1: (0.118, 0.954, -0.010),
    4: (0.157, 0.513, -0.015),
    7: (0.141, 0.081, -0.060),
    10: (0.137, 0.035, 0.095),
    13: (0.023, 1.460, 0.019),
    16: (0.179, 1.429, 0.014),
    18: (0.453, 1.415, -0.014),
    20: (0.711, 1.424, -0.016),
    22: (0.821, 1.418, -0.019),
}


def make_avatar(name="walker", scale=1.0):
    """A body of one Gaussian per joint."""
    joints = np.zeros((24, 3))
    for joint, (y, z) in CENTRE.items():
        joints[joint] = 0.0, y, z
    for joint, (x, y, z) in LEFT.items():
        joints[joint], joints[joint + 1] = (x, y, z), (-x, y, z)
    joints = (joints * scale).astype(np.float32)
    cloud = GaussianCloud(
        means_m=joints,
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (24, 1)),
        scales_m=np.full((24, 3), 0.02, np.float32),
        opacities=np.full(24, 0.9, np.float32),
        sh=np.zeros((24, 1, 3), np.float32),
    )
    index = np.zeros((24, 4), np.uint8)
    index[:, 0] = np.arange(24)
    weight = np.zeros((24, 4), np.float32)
    weight[:, 0] = 1.0
    return Avatar(
        name=name,
        license="CC0-1.0",
        height_m=1.78 * scale,
        cloud=cloud,
        lbs_index=index,
        lbs_weight=weight,
        joints_canonical_m=joints,
        joints_tpose_m=joints,
        R_tpose_canonical=np.tile(np.eye(3, dtype=np.float32), (24, 1, 1)),
    )


def spins_radps(G):
    """Fastest angular velocity of every joint over time [rad/s]."""
    R = np.einsum("tjki,tjkl->tjil", G[:-1], G[1:])
    cosine = 0.5 * (np.trace(R, axis1=2, axis2=3) - 1.0)
    return np.arccos(np.clip(cosine, -1.0, 1.0)).max(axis=0) * 20.0
