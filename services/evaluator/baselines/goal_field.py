"""The shortest way to a goal over a map, from everywhere."""

import math
from collections.abc import Iterator

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int32Array
from readygo.common.episode.grid_search import (
    FREE,
    UNITS_PER_CELL,
    UNREACHED,
    GridSearch,
    line_is_free,
)
from readygo.common.maps import OccupancyMap, clearance_m


class GoalField:
    """Distances to one goal on the cells of a map."""

    def __init__(self, occupancy: OccupancyMap, radius_m: float, goal_xy_m: tuple[float, float]) -> None:
        """Measure all ways.

        Args:
            occupancy: What blocks.
            radius_m: Of the disc that moves [m].
            goal_xy_m: Where to.
        """
        self._frame = occupancy.frame
        self.clearance_m: Float32Array = clearance_m(occupancy)
        self._factor = np.where(self.clearance_m > radius_m, np.uint8(FREE), np.uint8(0))
        goal = self._cell(goal_xy_m)
        self._factor[goal] = FREE
        self._units: Int32Array = GridSearch(self._factor.shape).distances(self._factor, goal)
        self._goal_xy_m = goal_xy_m

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Length of the way from a point to the goal [m]; inf where there is none."""
        units = min(int(self._units[cell]) for cell in self._around(self._cell((x_m, y_m))))
        return units / UNITS_PER_CELL * self._frame.resolution_m if units < UNREACHED else math.inf

    def ahead(self, x_m: float, y_m: float, lookahead_m: float) -> tuple[float, float]:
        """A point of the way to the goal, the farthest one within `lookahead_m` that can be reached straight [m]."""
        start = cell = self._cell((x_m, y_m))
        best = cell
        for _ in range(max(1, round(lookahead_m / self._frame.resolution_m))):
            cell = min(self._around(cell), key=lambda near: int(self._units[near]))
            if not self._straight(start, cell) and best != start:
                break
            best = cell
        if self._units[best] == 0 or self._units[best] >= UNREACHED or best == start:
            return self._goal_xy_m
        return self._frame.centre_m(*best)

    def clearances_m(self, xy_m: Float64Array) -> Float32Array:
        """Distances from points (N, 2) to what is nearest [m], shape (N,)."""
        return np.array([self.clearance_m[self._cell((x, y))] for x, y in xy_m.tolist()], np.float32)

    def is_free(self, from_xy_m: tuple[float, float], to_xy_m: tuple[float, float]) -> bool:
        """Is there room on the straight line between two points? What leads out of where there is none, is."""
        a, b = self._cell(from_xy_m), self._cell(to_xy_m)
        if self._factor[a] != FREE:
            return bool(self._factor[b] == FREE)
        return self._straight(a, b)

    def _straight(self, a: tuple[int, int], b: tuple[int, int]) -> bool:
        return bool(line_is_free(self._factor, a[0] + 0.5, a[1] + 0.5, b[0] + 0.5, b[1] + 0.5, FREE))

    def _around(self, cell: tuple[int, int]) -> Iterator[tuple[int, int]]:
        rows, columns = self._units.shape
        for i in range(max(cell[0] - 1, 0), min(cell[0] + 2, rows)):
            for j in range(max(cell[1] - 1, 0), min(cell[1] + 2, columns)):
                yield i, j

    def _cell(self, xy_m: tuple[float, float]) -> tuple[int, int]:
        i, j = self._frame.cell(*xy_m)
        rows, columns = self.clearance_m.shape
        return min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)
