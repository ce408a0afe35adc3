"""The z-up world and the y-up axes of SMPL, HumanML3D and glTF: (x, y, z)_zup = (x, -z, y)_yup.

Compiled and torch code writes the same rule out, see `fill_globals` in `readygo.common.avatars.kinematics`.
"""

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array


def zup_from_yup(points: npt.ArrayLike) -> Float64Array:
    """Points or directions in y-up axes, in the z-up world, shape (..., 3)."""
    p = np.asarray(points, dtype=np.float64)
    return np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1)


def yup_from_zup(points: npt.ArrayLike) -> Float64Array:
    """Points or directions of the z-up world, in y-up axes, shape (..., 3)."""
    p = np.asarray(points, dtype=np.float64)
    return np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1)
