"""Stand-in for the animator."""

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.messages import Motion


def upright_motion(xy_m: Float64Array) -> Motion:
    """An upright figure whose root is on a trajectory [m], shape (T, 2)."""
    root_m = np.column_stack([xy_m, np.full(len(xy_m), 0.9)]).astype(np.float32)
    return Motion(root_m=root_m, pose_axis_angle=np.zeros((len(xy_m), 24, 3), np.float32))
