"""Points of the floor as a robot sees them: x forward, y left."""

import math

import numpy as np

from readygo.common.arrays import Float64Array


def goal_in_robot_frame(
    x_m: float, y_m: float, yaw_rad: float, goal_xy_m: Float64Array | tuple[float, float]
) -> tuple[float, float]:
    """Goal in the frame of a robot at (x, y, yaw): forward and left [m]; scalars give the same bits everywhere."""
    dx, dy = float(goal_xy_m[0]) - x_m, float(goal_xy_m[1]) - y_m
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * dx + s * dy, c * dy - s * dx


def goals_in_robot_frames(xyyaw: Float64Array, goals_xy_m: Float64Array) -> Float64Array:
    """`goal_in_robot_frame` of many robots.

    Args:
        xyyaw: Poses x, y [m], yaw [rad], shape (N, 3).
        goals_xy_m: A goal in the world for each [m], shape (N, 2).

    Returns:
        Forward and left [m], shape (N, 2); NumPy's sine and cosine may differ from the scalar ones in the last bit.
    """
    dx, dy = (goals_xy_m - xyyaw[:, :2]).T
    c, s = np.cos(xyyaw[:, 2]), np.sin(xyyaw[:, 2])
    return np.stack([c * dx + s * dy, c * dy - s * dx], axis=1)
