"""What a collision is: the one definition behind every success rate.

Static: the robot's closed disc meets a closed, occupied, un-inflated cell of the robot's map; cells outside of the
grid count as occupied. Human: the distance of the centres is below the sum of the radii. Both are judged at every
simulation step.
"""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import OccupancyMap


@kernel_with_cache
def disc_meets_cells(
    occupied: BoolArray,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    x_m: float,
    y_m: float,
    radius_m: float,
) -> bool:
    """True if a disc meets an occupied cell; for compiled callers, see `meets_obstacle`."""
    height, width = occupied.shape
    i_first = math.floor((y_m - radius_m - origin_y_m) / resolution_m)
    i_last = math.floor((y_m + radius_m - origin_y_m) / resolution_m)
    j_first = math.floor((x_m - radius_m - origin_x_m) / resolution_m)
    j_last = math.floor((x_m + radius_m - origin_x_m) / resolution_m)
    for i in range(i_first, i_last + 1):
        y_low = origin_y_m + i * resolution_m
        dy = max(y_low - y_m, 0.0, y_m - (y_low + resolution_m))
        for j in range(j_first, j_last + 1):
            inside = 0 <= i < height and 0 <= j < width
            if inside and not occupied[i, j]:
                continue
            x_low = origin_x_m + j * resolution_m
            dx = max(x_low - x_m, 0.0, x_m - (x_low + resolution_m))
            if dx * dx + dy * dy <= radius_m * radius_m:
                return True
    return False


def meets_obstacle(occupancy: OccupancyMap, x_m: float, y_m: float, radius_m: float) -> bool:
    """True if a disc at (x, y) meets an occupied cell or leaves the grid (exact disc-square distance).

    Args:
        occupancy: Un-inflated map.
        x_m: Centre in the world [m].
        y_m: Centre in the world [m].
        radius_m: Radius of the disc [m]; tangency counts as meeting.
    """
    frame = occupancy.frame
    return bool(
        disc_meets_cells(occupancy.occupied, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, x_m, y_m, radius_m)
    )


@kernel_with_cache
def point_meets_humans(x_m: float, y_m: float, human_xy_m: Float64Array, contact_m: float) -> bool:
    """True if some human's centre is nearer than `contact_m`; for compiled callers, see `meets_human`."""
    for index in range(human_xy_m.shape[0]):
        dx, dy = human_xy_m[index, 0] - x_m, human_xy_m[index, 1] - y_m
        if dx * dx + dy * dy < contact_m * contact_m:
            return True
    return False


def meets_human(x_m: float, y_m: float, human_xy_m: Float64Array, contact_m: float) -> bool:
    """True if some human's centre is nearer than `contact_m`, the sum of both radii.

    Args:
        x_m: Robot in the world [m].
        y_m: Robot in the world [m].
        human_xy_m: Humans in the world [m], shape (N, 2).
        contact_m: Sum of the radii [m].
    """
    return bool(point_meets_humans(x_m, y_m, np.ascontiguousarray(human_xy_m).reshape(-1, 2), contact_m))
