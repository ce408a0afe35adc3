"""Motions of bodies whose joints lie where they are asked to."""

import numpy as np

from readygo.common.frames import yup_from_zup
from readygo.common.messages import Motion
from readygo.services.animator.smpl.fit import fit_rotations, pose_of


def fit_motion(joints_m, offsets_m):
    """The fitted motion of joints 0..21 or 0..23 in the z-up world [m], shape (T, 22 or 24, 3)."""
    G, _ = fit_rotations(yup_from_zup(joints_m), offsets_m)
    return Motion(root_m=joints_m[:, 0].astype(np.float32), pose_axis_angle=pose_of(G).astype(np.float32))
