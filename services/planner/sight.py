"""Who can see whom over a map of obstacles, whatever way they look."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from common.episode.grid_search import line_is_free
from common.maps import OccupancyMap
from services.planner.task import Point

Float64Array = npt.NDArray[np.float64]

_SHOULDER_M = 0.2
"""A person is hidden if the centre and both shoulders, this far to the sides of the line of sight, are [m]."""


class Sight:
    """Lines of sight over one map; what blocks the robot's body hides what is behind it, too."""

    def __init__(self, occupancy: OccupancyMap) -> None:
        self._free = np.where(occupancy.occupied, np.uint8(0), np.uint8(1))
        frame = occupancy.frame
        self._place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)

    def hides(self, robot_m: Point, human_m: Point) -> bool:
        """True if a robot cannot see any of a person's middle and shoulders."""
        return bool(_hides(self._free, *self._place, *robot_m, *human_m))

    def first_seen(self, robot_m: Float64Array, human_m: Float64Array) -> int:
        """First step at which the person is not hidden; the number of steps if none.

        Args:
            robot_m: Robot's position by step [m], shape (T, 2).
            human_m: Person's position by step [m], shape (T, 2).
        """
        return int(_first_seen(self._free, *self._place, robot_m, human_m))


@njit(cache=True)
def is_open(
    free: npt.NDArray[np.uint8], ox: float, oy: float, res: float, ax: float, ay: float, bx: float, by: float
) -> bool:
    """True if free cells (1) lie all along a line between two points."""
    i0, j0, i1, j1 = (ay - oy) / res, (ax - ox) / res, (by - oy) / res, (bx - ox) / res
    height, width = free.shape
    if min(i0, i1, j0, j1) < 0 or max(i0, i1) >= height or max(j0, j1) >= width:
        return False
    return bool(line_is_free(free, i0, j0, i1, j1, 1))


@njit(cache=True)
def _hides(
    free: npt.NDArray[np.uint8], ox: float, oy: float, res: float, ax: float, ay: float, bx: float, by: float
) -> bool:
    dx, dy = bx - ax, by - ay
    norm = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    for side in range(-1, 2):
        x, y = bx - side * _SHOULDER_M * dy / norm, by + side * _SHOULDER_M * dx / norm
        if is_open(free, ox, oy, res, ax, ay, x, y):
            return False
    return True


@njit(cache=True)
def _first_seen(
    free: npt.NDArray[np.uint8], ox: float, oy: float, res: float, robot: Float64Array, human: Float64Array
) -> int:
    for step in range(len(robot)):
        if not _hides(free, ox, oy, res, robot[step, 0], robot[step, 1], human[step, 0], human[step, 1]):
            return step
    return len(robot)
