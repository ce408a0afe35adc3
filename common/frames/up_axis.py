"""The z-up world and the y-up axes of SMPL, HumanML3D and glTF: (x, y, z)_zup = (x, -z, y)_yup; axes of cameras.

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


def swap_opengl_axes(T_world_camera: npt.ArrayLike) -> Float64Array:
    """Poses of cameras with OpenCV axes of those with OpenGL axes, or the other way around.

    OpenCV's are x right, y down, z forward; OpenGL's are x right, y up, z backward.

    Args:
        T_world_camera: Shape (..., 4, 4).
    """
    swapped: Float64Array = np.asarray(T_world_camera, dtype=np.float64) * np.array([1.0, -1.0, -1.0, 1.0])
    return swapped
