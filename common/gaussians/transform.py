"""Similarity transforms, concatenation and cropping of Gaussian clouds."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.errors import SceneError
from readygo.common.frames import quat_from_matrix, quat_multiply
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import rotate_sh

R_UP = {
    "+z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "+y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "+x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}
"""Rotations that map each axis to +z and keep one of the others."""


def R_from_up(up: str) -> Float64Array:
    """Rotation that maps a file's up axis to +z, turning no further than it must.

    Args:
        up: One of +x, -x, +y, -y, +z, -z; a sign may be left out for +. Or a direction, as three numbers with commas.

    Returns:
        Rotation matrix, shape (3, 3).

    Raises:
        SceneError: If `up` names no axis.
    """
    axis = up.strip().lower()
    if axis.count(",") == 2:
        return _R_from_direction(axis, up)
    axis = axis if axis[:1] in ("+", "-") else f"+{axis}"
    if axis not in R_UP:
        raise SceneError(
            f"Unknown up axis {up!r}; use one of {', '.join(R_UP)}, or three numbers such as 0.1,-0.99,0.05."
        )
    return np.array(R_UP[axis], dtype=np.float64)


def _R_from_direction(text: str, up: str) -> Float64Array:
    """The rotation of the nearest axis, and then the smallest one."""
    try:
        direction = np.array([float(word) for word in text.split(",")])
    except ValueError:
        direction = np.zeros(3)
    length = float(np.sqrt(direction @ direction))
    if not (0 < length < np.inf):
        raise SceneError(f"The up direction {up!r} must be three numbers that are not all 0.")
    direction /= length
    R_axis = max((np.array(R, dtype=np.float64) for R in R_UP.values()), key=lambda R: float(R[2] @ direction))
    x, y, z = R_axis @ direction
    # Rodrigues' formula for the rotation that takes (x, y, z) to (0, 0, 1); z is at least 1 / sqrt(3).
    tilt = np.array(
        [[1 - x * x / (1 + z), -x * y / (1 + z), -x], [-x * y / (1 + z), 1 - y * y / (1 + z), -y], [x, y, z]]
    )
    turned: Float64Array = tilt @ R_axis
    return turned


def transform_cloud(
    cloud: GaussianCloud, R: npt.ArrayLike, translate_m: npt.ArrayLike = (0.0, 0.0, 0.0), scale: float = 1.0
) -> GaussianCloud:
    """Move a cloud: x' = scale R x + translate, with its Gaussians' orientation, size and view-dependent colour.

    Args:
        cloud: Gaussians.
        R: Rotation, shape (3, 3).
        translate_m: Translation after rotation and scaling [m], shape (3,).
        scale: Positive factor on lengths.

    Raises:
        ValueError: If `R` is no rotation, or `scale` is not positive and finite.
    """
    R, t = np.asarray(R, dtype=np.float64), np.asarray(translate_m, dtype=np.float64)
    if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-5) or np.linalg.det(R) < 0:
        raise ValueError(f"R must be a rotation matrix of shape (3, 3), got {R.tolist()}.")
    if not (0 < scale < np.inf) or not np.isfinite(t).all():
        raise ValueError(f"scale must be positive and translate_m finite, got {scale} and {t.tolist()}.")
    means = cloud.means_m.astype(np.float64)
    rotated = means[:, :1] * R[:, 0] + means[:, 1:2] * R[:, 1] + means[:, 2:3] * R[:, 2]
    turned = not np.array_equal(R, np.eye(3))
    return GaussianCloud(
        means_m=(scale * rotated + t).astype(np.float32),
        quats_wxyz=quat_multiply(quat_from_matrix(R), cloud.quats_wxyz).astype(np.float32)
        if turned
        else cloud.quats_wxyz,
        scales_m=(cloud.scales_m * scale).astype(np.float32),
        opacities=cloud.opacities,
        sh=rotate_sh(cloud.sh, R) if turned else cloud.sh,
    )


def concatenate(clouds: Sequence[GaussianCloud]) -> GaussianCloud:
    """All Gaussians of several clouds, in order; lower SH degrees are padded with zeros.

    Raises:
        ValueError: If `clouds` is empty.
    """
    if not clouds:
        raise ValueError("concatenate needs at least one cloud.")
    width = max(cloud.sh.shape[1] for cloud in clouds)
    return GaussianCloud(
        means_m=np.concatenate([cloud.means_m for cloud in clouds]),
        quats_wxyz=np.concatenate([cloud.quats_wxyz for cloud in clouds]),
        scales_m=np.concatenate([cloud.scales_m for cloud in clouds]),
        opacities=np.concatenate([cloud.opacities for cloud in clouds]),
        sh=np.concatenate([np.pad(c.sh, ((0, 0), (0, width - c.sh.shape[1]), (0, 0))) for c in clouds]),
    )
