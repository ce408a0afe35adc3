"""Floor that humans do not walk on: steep slopes and steps."""

import numpy as np

from readygo.common.maps import FloorMap, OccupancyMap

_RUN_M = 0.3
"""Slopes are measured across this distance: about a step's length, and more than a map's noise [m]."""


def without_slopes(occupancy: OccupancyMap, floor: FloorMap, slope_max: float) -> OccupancyMap:
    """A map with the floor blocked that humans do not walk on: steep slopes and steps.

    Args:
        occupancy: What blocks humans.
        floor: Height of the floor.
        slope_max: Largest rise over run across 0.3 m; 0 does not look at the floor.
    """
    if slope_max <= 0:
        return occupancy
    frame, (rows, columns) = occupancy.frame, occupancy.occupied.shape
    x, y = frame.centre_m(np.arange(rows), np.arange(columns))
    height = floor.at_many(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns)
    reach = max(1, round(0.5 * _RUN_M / frame.resolution_m))
    run_m = 2 * reach * frame.resolution_m
    padded = np.pad(height, reach, mode="edge")
    middle = slice(reach, -reach)
    rise_x = padded[middle, 2 * reach :] - padded[middle, : -2 * reach]
    rise_y = padded[2 * reach :, middle] - padded[: -2 * reach, middle]
    steep = rise_x * rise_x + rise_y * rise_y > (slope_max * run_m) ** 2
    return OccupancyMap(frame=frame, occupied=occupancy.occupied | steep)
