"""Remaining distance to a goal from everywhere on a map, on coarse cells, and where the shortest path leads."""

import math

import numpy as np

from readygo.common.arrays import Float64Array, UInt16Array
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL, UNREACHED, GridSearch
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame, OccupancyMap, clearance_m

COARSE = 2
"""Cells of the map along an edge of a coarse cell."""
BLOCKED_COST = 1.5
"""Metres of path that a metre within a blocked area counts as."""
_CM_MAX = 65_000

Place = tuple[float, float, float]
"""Corner x, y of a grid in the world and edge of its cells [m]."""


def coarse_place(frame: GridFrame) -> Place:
    """Where the coarse cells of a map are."""
    return frame.origin_x_m, frame.origin_y_m, COARSE * frame.resolution_m


class GoalDistances:
    """Measures remaining distances on one map; not thread-safe."""

    def __init__(self, occupancy: OccupancyMap, radius_m: float) -> None:
        """Prepare a map.

        Args:
            occupancy: What blocks.
            radius_m: Radius of the disc that moves [m].
        """
        self._frame = occupancy.frame
        self._factor = np.where(clearance_m(occupancy) > radius_m, np.uint8(FREE), np.uint8(0))
        self._search = GridSearch(self._factor.shape)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of coarse cells."""
        return _coarse_shape(self._factor)

    def to_goal_cm(self, goal_xy_m: tuple[float, float]) -> UInt16Array:
        """Remaining distance from every coarse cell [cm], shape (H / 2, W / 2), halves rounded up.

        Blocked cells have the distance of the nearest free one, and the way there.

        Args:
            goal_xy_m: The goal in the world [m].
        """
        from scipy import ndimage

        i, j = self._frame.cell(*goal_xy_m)
        rows, columns = self._factor.shape
        goal = min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)
        factor = self._factor
        if factor[goal] == 0:
            factor = factor.copy()
            factor[goal] = FREE
        units = _coarse_minimum(self._search.distances(factor, goal))
        blocked = units >= UNREACHED
        away, (near_i, near_j) = ndimage.distance_transform_edt(blocked, return_indices=True)
        cell_m = self._frame.resolution_m
        metres = units[near_i, near_j] / UNITS_PER_CELL * cell_m + away * (COARSE * cell_m * BLOCKED_COST)
        field_cm: UInt16Array = np.minimum(np.round(metres * 100.0), _CM_MAX).astype(np.uint16)
        return field_cm


def _coarse_shape(cells: np.ndarray) -> tuple[int, int]:
    rows, columns = cells.shape
    return -(-rows // COARSE), -(-columns // COARSE)


def _coarse_minimum(units: np.ndarray) -> Float64Array:
    rows, columns = _coarse_shape(units)
    padded = np.full((rows * COARSE, columns * COARSE), UNREACHED, np.int64)
    padded[: units.shape[0], : units.shape[1]] = units
    least: Float64Array = padded.reshape(rows, COARSE, columns, COARSE).min(axis=(1, 3)).astype(np.float64)
    return least


@kernel_with_cache
def remaining_m(field_cm: UInt16Array, place: Place, x_m: float, y_m: float) -> float:
    """Remaining distance from a point [m], bilinear between the centres of coarse cells.

    Args:
        field_cm: From `GoalDistances.to_goal_cm`.
        place: From `coarse_place`.
        x_m: World x [m].
        y_m: World y [m].
    """
    rows, columns = field_cm.shape
    across = min(max((x_m - place[0]) / place[2] - 0.5, 0.0), columns - 1.000001)
    along = min(max((y_m - place[1]) / place[2] - 0.5, 0.0), rows - 1.000001)
    i, j = int(along), int(across)
    u, v = along - i, across - j
    low = (1.0 - v) * field_cm[i, j] + v * field_cm[i, j + 1]
    high = (1.0 - v) * field_cm[i + 1, j] + v * field_cm[i + 1, j + 1]
    return float(0.01 * ((1.0 - u) * low + u * high))


@kernel_with_cache
def point_ahead(field_cm: UInt16Array, place: Place, x_m: float, y_m: float, steps: int) -> tuple[float, float]:
    """A point of the shortest path, some coarse cells ahead: x, y in the world [m].

    Args:
        field_cm: From `GoalDistances.to_goal_cm`.
        place: From `coarse_place`.
        x_m: World x [m].
        y_m: World y [m].
        steps: Cells to go down the field.
    """
    rows, columns = field_cm.shape
    i = min(max(math.floor((y_m - place[1]) / place[2]), 0), rows - 1)
    j = min(max(math.floor((x_m - place[0]) / place[2]), 0), columns - 1)
    for _ in range(steps):
        best_i, best_j, best = i, j, field_cm[i, j]
        for a in range(max(i - 1, 0), min(i + 2, rows)):
            for b in range(max(j - 1, 0), min(j + 2, columns)):
                if field_cm[a, b] < best:
                    best_i, best_j, best = a, b, field_cm[a, b]
        if best_i == i and best_j == j:
            break
        i, j = best_i, best_j
    return place[0] + (j + 0.5) * place[2], place[1] + (i + 0.5) * place[2]
