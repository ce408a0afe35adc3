"""Similarity transforms, concatenation and cropping of Gaussian clouds."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

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


def R_from_up(up: str) -> npt.NDArray[np.float64]:
    """Rotation that maps a file's up axis to +z.

    Args:
        up: One of +x, -x, +y, -y, +z, -z; a sign may be left out for +.

    Returns:
        Rotation matrix, shape (3, 3).

    Raises:
        SceneError: If `up` names no axis.
    """
    axis = up.strip().lower()
    axis = axis if axis[:1] in ("+", "-") else f"+{axis}"
    if axis not in R_UP:
        raise SceneError(f"Unknown up axis {up!r}; use one of {', '.join(R_UP)}.")
    return np.array(R_UP[axis], dtype=np.float64)


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
