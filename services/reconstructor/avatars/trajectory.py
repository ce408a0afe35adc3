"""What given poses tell of how a person moved: the likeliest motion, and how far it may be off, before any image.

The pose of each frame is a measurement with a separate error, and the motion is smooth. Legend: y_f = an entry of a
joint's rotation matrix, or a coordinate of the pelvis, in frame f; D = second differences between frames, divided ones
where these are not evenly spaced in time; s = standard deviation of the errors. The likeliest motion minimises

    sum_f (x_f - y_f)^2 + l |D x|^2,   so x = U h U^T y,   h = 1 / (1 + l e),   with D^T D = U e U^T

and what is left of the errors has the covariance s^2 U h U^T: it is made of modes, the columns of U, whose standard
deviations are s sqrt(h). The smoothness l of each joint is that with the least generalised cross-validation score
F r / (F - sum h)^2, where r is the sum of squares that the smoothing leaves; then s^2 = r / (F - sum h).

Errors that last for many frames do not show in the poses: slow modes may be off by `drift_deg` and `drift_m` besides.

Sources: Eilers, A perfect smoother, 2003; Craven and Wahba, Smoothing noisy data with spline functions, 1979.
"""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars.posing import nearest_rotation
from readygo.common.errors import AvatarError
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.services.reconstructor.avatars.config import PosePriorConfig

_SMOOTHNESS = np.exp(np.linspace(-8.0, 16.0, 97))
"""Values of l that are tried: from none to a straight line over hundreds of frames."""
_ENTRY_SHARE = np.sqrt(2.0 / 3.0)
"""Standard deviation of the entries of a rotation matrix, as a share of that of the rotation about each axis [1/rad]:
the squared Frobenius norm of a small turn is twice its squared angle."""
ORDERLY_M, ORDERLY_DEG = 0.15, 15.0
"""Largest errors of the pelvis, and of its rotation, of poses in the order of time. Of a walk that is given to 2 cm and
3 degrees, 0.02 m and 3 degrees are found in order, 0.26 m and 17 degrees where frame 10 comes before frame 2."""
_DRIFT_SMOOTHNESS = 100.0
"""l of errors that last: half of them is left at a period of 20 frames."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseTrajectory:
    """A motion of F frames and its standard deviations."""

    pose_axis_angle: Float64Array
    """The likeliest rotations of the joints [rad], shape (F, 24, 3)."""
    root_m: Float64Array
    """The likeliest pelvises [m], shape (F, 3)."""
    modes: Float64Array
    """Orthonormal courses over the frames, in columns, shape (F, F)."""
    joint_rad: Float64Array
    """Standard deviation of each mode, for a turn of each joint about each of its parent's axes [rad], (24, F)."""
    modes_m: Float64Array
    """Standard deviation of each mode for each coordinate of the pelvis [m], shape (F,)."""


def smoothed_trajectory(
    pose_axis_angle: Float64Array, root_m: Float64Array, prior: PosePriorConfig, *, times: Float64Array | None = None
) -> PoseTrajectory:
    """The trajectory of poses whose frames follow each other in time, with errors that are found from them.

    Args:
        pose_axis_angle: Given poses [rad], shape (F, 24, 3).
        root_m: Given pelvises [m], shape (F, 3).
        prior: How far they drift.
        times: When the frames were taken, in usual spacings, shape (F,); None where they are evenly spaced.

    Raises:
        AvatarError: If the pelvis jumps from frame to frame: the frames are not in the order of time.
    """
    count = len(root_m)
    roughness, modes = _modes(count, times)
    entries = matrix_from_axis_angle(pose_axis_angle).reshape(count, 24, 9)
    smooth, joint_rad = np.empty_like(entries), np.empty((24, count))
    drift = 1.0 / (1.0 + _DRIFT_SMOOTHNESS * roughness)
    root, found_m, kept = _smoothed(root_m, roughness, modes)
    modes_m = np.sqrt(found_m**2 * kept + prior.drift_m**2 * drift)
    for joint in range(24):
        smooth[:, joint], found, kept = _smoothed(entries[:, joint], roughness, modes)
        found_rad = found / _ENTRY_SHARE
        if joint == 0:
            _check_order(found_m, float(np.rad2deg(found_rad)))
        joint_rad[joint] = np.sqrt(found_rad**2 * kept + np.deg2rad(prior.drift_deg) ** 2 * drift)
    return PoseTrajectory(
        pose_axis_angle=axis_angle_from_matrix(nearest_rotation(smooth.reshape(count, 24, 3, 3))),
        root_m=root,
        modes=modes,
        joint_rad=joint_rad,
        modes_m=modes_m,
    )


def trusted_trajectory(
    pose_axis_angle: Float64Array,
    root_m: Float64Array,
    *,
    joint_deg: float,
    root_sd_m: float,
    jerk_deg: float = np.inf,
    jerk_m: float = np.inf,
    times: Float64Array | None = None,
) -> PoseTrajectory:
    """Poses as they are given, with errors of stated sizes.

    Args:
        pose_axis_angle: Poses [rad], shape (F, 24, 3).
        root_m: Pelvises [m], shape (F, 3).
        joint_deg: Standard deviation of the joints' errors about each axis [deg].
        root_sd_m: That of the pelvises' coordinates [m].
        jerk_deg: Standard deviation of an error from the middle of those before and after [deg]; infinite where frames
            do not follow each other in time.
        jerk_m: The same of the pelvis [m].
        times: When the frames were taken, in usual spacings, shape (F,); None where they are evenly spaced.
    """
    roughness, modes = _modes(len(root_m), times)
    # A second difference is twice the distance from the middle.
    turned, moved = ((0.5 * sd / jerk) ** 2 for sd, jerk in ((joint_deg, jerk_deg), (root_sd_m, jerk_m)))
    return PoseTrajectory(
        pose_axis_angle=pose_axis_angle,
        root_m=root_m,
        modes=modes,
        joint_rad=np.tile(np.deg2rad(joint_deg) / np.sqrt(1.0 + turned * roughness), (24, 1)),
        modes_m=root_sd_m / np.sqrt(1.0 + moved * roughness),
    )


def _modes(count: int, times: Float64Array | None = None) -> tuple[Float64Array, Float64Array]:
    """Squared second differences of the modes, and the modes in columns, the slowest first."""
    second = np.diff(np.eye(count), n=2, axis=0) if times is None else second_differences(times)
    roughness, modes = np.linalg.eigh(second.T @ second)
    return np.maximum(roughness, 0.0), modes


def second_differences(times: Float64Array) -> Float64Array:
    """Rows that take the second differences of values at times in usual spacings, each for the time that it stands for.

    Twice the distance from the middle of the values before and after, where times are evenly spaced; shape (F - 2, F).
    """
    steps = np.diff(times)
    first = np.diff(np.eye(len(times)), axis=0) / steps[:, None]
    span = 0.5 * (steps[1:] + steps[:-1])[:, None]
    second: Float64Array = np.diff(first, axis=0) / np.sqrt(span)
    return second


def _check_order(root_m: float, turn_deg: float) -> None:
    if root_m > ORDERLY_M or turn_deg > ORDERLY_DEG:
        raise AvatarError(
            f"The given pelvises are {root_m:.2f} m and {turn_deg:.0f} deg off any smooth motion: the frames, by their "
            "names, are not in the order of time. Name them in that order (frame_0002 before frame_0010), or set "
            "--prior.in-order false."
        )


def _smoothed(
    values: Float64Array, roughness: Float64Array, modes: Float64Array
) -> tuple[Float64Array, float, Float64Array]:
    """Values (F, K) of one smoothness, smoothed; their standard deviation; which share of each mode is left, (F,)."""
    count, columns = values.shape
    parts = modes.T @ values
    squares = (parts**2).sum(axis=1)
    kept = 1.0 / (1.0 + _SMOOTHNESS[:, None] * roughness)
    left = ((1.0 - kept) ** 2 * squares).sum(axis=1)
    free = count - kept.sum(axis=1)
    best = int(np.argmin(left / free**2))
    deviation = float(np.sqrt(left[best] / (free[best] * columns)))
    return modes @ (kept[best][:, None] * parts), deviation, kept[best]
