"""How near a run came to the humans' real bodies, beside the discs that collisions are judged by."""

import math
from collections.abc import Sequence

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import footprint_xy
from readygo.common.maps import FloorMap
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.interface import HumanBody

_REACH_M = 0.4
"""A body's parts differ in distance by about this much: steps whose centres are farther apart cannot be the nearest."""
_STRIDE = 2


def gaussian_clearance_m(
    xyyaw: Float64Array,
    bodies: Sequence[HumanBody],
    floor: FloorMap,
    robot: RobotConfig,
) -> float:
    """Least distance of the robot's disc to the thinned Gaussians of humans, up to the robot's height.

    Measured at every second step of those at which a human is nearly as near as ever.

    Args:
        xyyaw: The robot's poses at 20 Hz [m, m, rad], shape (T, 3).
        bodies: Motion, avatar and footprint of every human.
        floor: What the robot stands on.
        robot: Radius and height.

    Returns:
        Distance [m], below 0 if a point is inside of the disc; inf without humans.
    """
    nearest = math.inf
    for who, avatar, model in bodies:
        rows = np.minimum(np.arange(len(xyyaw)), len(who.motion.root_m) - 1)
        gap = who.motion.root_m[rows, :2].astype(np.float64) - xyyaw[:, :2]
        distance = np.sqrt(gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1])
        for step in np.flatnonzero(distance <= min(distance.min(), nearest + _REACH_M) + _REACH_M)[::_STRIDE].tolist():
            x, y = float(xyyaw[step, 0]), float(xyyaw[step, 1])
            points = footprint_xy(model, avatar, who.motion, step, z_max_m=floor.at(x, y) + robot.height_m)
            if len(points) > 0:
                dx, dy = points[:, 0] - x, points[:, 1] - y
                nearest = min(nearest, math.sqrt(float(np.min(dx * dx + dy * dy))) - robot.radius_m)
    return nearest
