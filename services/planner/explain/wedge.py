"""The ground on which the robot's camera sees humans, for pictures: its field of view, cut where they are hidden."""

import math
from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float64Array

RAY_SPACING_RAD = math.radians(1.0)
COARSE_M, FINE_M = 0.2, 0.05
"""Steps along a ray: how far apart humans are looked for, and how well the place where they vanish is known [m]."""


def wedge_m(
    xyyaw: Float64Array,
    borders_rad: tuple[float, float],
    range_m: float,
    *,
    sees: Callable[[float, float], bool] | None = None,
) -> Float64Array:
    """Outline of where a camera sees humans from a pose.

    Args:
        xyyaw: x [m], y [m], yaw [rad], shape (3,).
        borders_rad: Bearings of the image's right and left border from the yaw [rad].
        range_m: Nothing farther is seen [m].
        sees: True if a human at a point is not hidden; None looks through everything.

    Returns:
        Corners of a polygon that begins at the camera [m], shape (N, 2).
    """
    x, y, yaw = xyyaw.tolist()
    right_rad, left_rad = borders_rad
    count = max(2, math.ceil((left_rad - right_rad) / RAY_SPACING_RAD) + 1)
    corners = [(x, y)]
    for bearing in (yaw + np.linspace(right_rad, left_rad, count)).tolist():
        c, s = math.cos(bearing), math.sin(bearing)
        reach_m = range_m if sees is None else _reach_m(sees, x, y, c, s, range_m)
        corners.append((x + reach_m * c, y + reach_m * s))
    return np.array(corners)


def _reach_m(sees: Callable[[float, float], bool], x: float, y: float, c: float, s: float, range_m: float) -> float:
    """How far humans are seen along a ray: up to the first place where they are hidden [m]."""
    for coarse in range(1, math.floor(range_m / COARSE_M + 1e-9) + 1):
        if not sees(x + coarse * COARSE_M * c, y + coarse * COARSE_M * s):
            seen_m = (coarse - 1) * COARSE_M
            for fine in range(1, round(COARSE_M / FINE_M)):
                reach_m = (coarse - 1) * COARSE_M + fine * FINE_M
                if not sees(x + reach_m * c, y + reach_m * s):
                    break
                seen_m = reach_m
            return seen_m
    return range_m
