"""Free distances that perception sees, as a scan about the robot: ROS's LaserScan (REP 103, REP 117).

Legend: e the camera's place, p_k the end of the ray of column k, d the direction of a scan's ray from the robot's
centre. A ray of the scan ends where it first meets a line from p_k to p_k+1: t d = p_k + s (p_k+1 - p_k), 0 <= s <= 1.
With the camera at the centre and d at the bearing of a column, t is the column's free distance.
"""

import numpy as np

from readygo.apps.drive.messages import ScanMessage
from readygo.common.arrays import Float64Array
from readygo.common.camera import CameraConfig
from readygo.common.perception.episode import LOOK_S
from readygo.common.perception.grid import polar_grid

RAYS = 64
"""Rays of a scan, evenly spaced between the outermost columns."""
RANGE_MAX_M = 9.0
"""Farther ranges are infinite [m]: the network learns distances up to 10 m, and its error is larger than the rest."""
_SLACK = 1e-9
"""Of s: rays at the ends of a line meet it."""


def scan_of(rays_m: Float64Array, camera: CameraConfig, *, stamp_ns: int, frame: str) -> ScanMessage:
    """Free distances as a scan about the robot's centre.

    Args:
        rays_m: Free distances from the camera in the directions of its columns [m], shape (C,).
        camera: The camera that perception was trained with.
        stamp_ns: Capture time of the image [ns].
        frame: Name of the robot's frame.

    Returns:
        Ranges are NaN where the camera does not see, and infinite beyond `RANGE_MAX_M`.
    """
    grid, (x_m, y_m, yaw_rad) = polar_grid(camera), camera.eye(0.0, 0.0, 0.0)
    ends = np.array([x_m, y_m]) + rays_m[:, None] * _directions(yaw_rad + grid.bearings_rad)
    # The bearings fall, angles of a scan rise.
    angles = yaw_rad + np.linspace(grid.bearings_rad[-1], grid.bearings_rad[0], RAYS)
    d, p, along = _directions(angles)[:, None], ends[:-1], np.diff(ends, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = _cross(p, along) / _cross(d, along), _cross(p, d) / _cross(d, along)
    meets = (t >= 0.0) & (s >= -_SLACK) & (s <= 1.0 + _SLACK)
    ranges_m = np.where(meets, t, np.inf).min(axis=1)
    ranges_m[ranges_m > RANGE_MAX_M] = np.inf
    ranges_m[~meets.any(axis=1)] = np.nan
    return ScanMessage(
        stamp_ns=stamp_ns,
        frame=frame,
        angle_min_rad=float(angles[0]),
        angle_increment_rad=float(angles[1] - angles[0]),
        range_max_m=RANGE_MAX_M,
        period_s=LOOK_S,
        ranges_m=tuple(ranges_m.tolist()),
    )


def _directions(angles_rad: Float64Array) -> Float64Array:
    """Unit vectors, shape (N, 2)."""
    return np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=1)


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Cross products of vectors in the plane, shape (..., 2)."""
    product: Float64Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
