"""Errors of the poses that a reconstruction found in a capture.

Legend: S = the similarity that maps found camera centres to the true ones with the least squared error.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from readygo.apps.capture.truth import Truth
from readygo.common.arrays import Float64Array
from readygo.common.errors import SceneError
from readygo.services.reconstructor import Similarity, umeyama


@dataclass(frozen=True, kw_only=True)
class FoundPoseErrors:
    """Errors of found poses against the true ones."""

    images: int
    """Images of the capture that have a pose."""
    of: int
    """Images of the capture."""
    scale_percent: float
    """Found lengths over true ones, less 1 [%]: one over the scale of S."""
    camera_rmse_m: float
    """RMS error of camera centres after the best rotation and translation; includes the scale error [m]."""
    shape_rmse_m: float
    """RMS error of camera centres after S [m]."""
    camera_max_m: float
    """Largest error of a camera centre after the best rotation and translation [m]."""
    rotation_deg: float
    """Median angle between found and true orientation after S [deg]."""
    up_deg: float
    """Angle between the found and the true vertical [deg]."""
    height_m: float
    """Mean height of the cameras in the found frame less the true one [m]."""

    def to_mapping(self) -> dict[str, float]:
        """Plain, rounded values."""
        return {name: value if isinstance(value, int) else round(value, 5) for name, value in asdict(self).items()}


def pose_errors(truth: Truth, found: Mapping[str, Float64Array]) -> FoundPoseErrors:
    """Compare found poses with the truth.

    Args:
        truth: Ground truth of the capture.
        found: `T_world_camera`, shape (4, 4), metres, z up, by image name.

    Raises:
        SceneError: If fewer than three images are in both.
    """
    true = truth.poses
    names = sorted(set(true) & set(found))
    if len(names) < 3:
        raise SceneError(f"Only {len(names)} of {len(found)} images are those of the capture; is it another one?")
    T_true, T_found = np.array([true[name] for name in names]), np.array([found[name] for name in names])
    p_true, p_found = T_true[:, :3, 3], T_found[:, :3, 3]
    similar = umeyama(p_found, p_true)
    rigid = Similarity(scale=1.0, R=similar.R, t=p_true.mean(axis=0) - similar.R @ p_found.mean(axis=0))
    off_m = np.linalg.norm(rigid.apply(p_found) - p_true, axis=1)
    shape_m = np.linalg.norm(similar.apply(p_found) - p_true, axis=1)
    turned = np.swapaxes(T_true[:, :3, :3], 1, 2) @ similar.R @ T_found[:, :3, :3]
    return FoundPoseErrors(
        images=len(names),
        of=len(true),
        scale_percent=100.0 * (1.0 / similar.scale - 1.0),
        camera_rmse_m=_rms(off_m),
        shape_rmse_m=_rms(shape_m),
        camera_max_m=float(off_m.max()),
        rotation_deg=float(np.median([_angle_deg(np.trace(R)) for R in turned])),
        up_deg=math.degrees(math.acos(min(1.0, float(similar.R[2, 2])))),
        height_m=float(p_found[:, 2].mean() - p_true[:, 2].mean()),
    )


def _rms(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _angle_deg(trace: float) -> float:
    return math.degrees(math.acos(min(1.0, max(-1.0, 0.5 * (trace - 1.0)))))
