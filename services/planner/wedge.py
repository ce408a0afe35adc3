"""The ground that the robot's camera looks at, for pictures: the wedge of its field of view, cut at obstacles."""

import math

import numpy as np
import numpy.typing as npt

from common.maps import OccupancyMap

Float64Array = npt.NDArray[np.float64]
RAY_SPACING_RAD = math.radians(0.5)


def wedge_m(
    xyyaw: Float64Array, fov_rad: float, range_m: float, *, occupancy: OccupancyMap | None = None
) -> Float64Array:
    """Outline of what a camera sees from a pose.

    Args:
        xyyaw: x [m], y [m], yaw [rad], shape (3,).
        fov_rad: Horizontal field of view [rad].
        range_m: Nothing farther is seen [m].
        occupancy: What ends a line of sight; None looks through everything.

    Returns:
        Corners of a polygon that begins at the robot [m], shape (N, 2).
    """
    count = max(2, math.ceil(fov_rad / RAY_SPACING_RAD) + 1)
    bearings = float(xyyaw[2]) + np.linspace(-0.5, 0.5, count) * fov_rad
    rays = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    reach_m = np.full(count, range_m) if occupancy is None else _reach_m(occupancy, xyyaw[:2], rays, range_m)
    return np.concatenate([xyyaw[None, :2], xyyaw[:2] + reach_m[:, None] * rays])


def _reach_m(occupancy: OccupancyMap, eye_m: Float64Array, rays: Float64Array, range_m: float) -> Float64Array:
    """Length of each line of sight up to the first occupied cell [m], shape (N,)."""
    frame, shape = occupancy.frame, occupancy.occupied.shape
    lengths_m = np.arange(0.0, range_m, 0.5 * frame.resolution_m)
    points = eye_m + lengths_m[None, :, None] * rays[:, None, :]
    j = np.floor((points[..., 0] - frame.origin_x_m) / frame.resolution_m).astype(np.int64)
    i = np.floor((points[..., 1] - frame.origin_y_m) / frame.resolution_m).astype(np.int64)
    inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
    hit = np.zeros(inside.shape, np.bool_)
    hit[inside] = occupancy.occupied[i[inside], j[inside]]
    return np.where(hit.any(axis=1), lengths_m[hit.argmax(axis=1)], range_m)
