"""Shortest ways on a grid: a bucket queue over integer costs, as flood (Dijkstra) or towards one cell (A*).

A cell's factor says what a step into it costs, in quarters of free ground: 0 is blocked, 4 is free, up to 60 is costly.
Source: R. Dial, Algorithm 360: Shortest-path forest with topological ordering, CACM 12 (1969).
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, Int64Array, UInt8Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame, OccupancyMap, clearance_m

FREE = 4
"""Factor of free ground."""
FACTOR_MAX = 60
UNITS_PER_CELL = 20
"""Cost of a straight step over free ground; a diagonal one costs 28."""
UNREACHED = 1 << 30
"""Distance of cells that the search did not reach."""

_STRAIGHT, _DIAGONAL = 5, 7
_BUCKET_COUNT = 512  # above the costliest step (7 * 60) plus the heuristic's change (28)
_BUCKET_MASK = _BUCKET_COUNT - 1

Cell = tuple[int, int]


class GridSearch:
    """Working memory for searches on grids of one shape; not thread-safe."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        capacity = 2 * shape[0] * shape[1] + 64
        self._heads = np.empty(_BUCKET_COUNT, np.int32)
        self._entry_cell = np.empty(capacity, np.int32)
        self._entry_next = np.empty(capacity, np.int32)
        # A rim of blocked cells saves to ask whether a neighbour lies in the grid.
        self._rimmed_factor = np.zeros((shape[0] + 2, shape[1] + 2), np.uint8)
        self._rimmed_distance = np.full((shape[0] + 2, shape[1] + 2), UNREACHED, np.int32)
        self._distance = self._rimmed_distance[1:-1, 1:-1]
        self._reached = np.empty(shape[0] * shape[1], np.int32)
        self._reached_count = 0

    def distances(
        self,
        factor: UInt8Array,
        source: Cell,
        *,
        target: Cell | None = None,
        slack_units: int = 0,
        out: Int32Array | None = None,
    ) -> Int32Array:
        """Cost of the cheapest way from every cell to `source`, with UNITS_PER_CELL a straight free step.

        Args:
            factor: Cost factors, shape (H, W); the source's own cell may be blocked.
            source: Row and column that distances are measured from.
            target: Where the flood may stop; farther cells stay at UNREACHED or above their true distance.
            slack_units: How far the flood continues beyond the target's distance.
            out: Array to fill, shape (H, W); a new one without.
        """
        out = np.empty(self.shape, np.int32) if out is None else out
        self._flood(factor, source, target, slack_units, False)
        out[:] = self._distance
        return out

    def path(self, factor: UInt8Array, start: Cell, goal: Cell) -> Int64Array | None:
        """Cheapest 8-connected way from `start` to `goal` (both included), shape (N, 2), or None."""
        reached = self._flood(factor, goal, start, 0, True)
        if not reached:
            return None
        cells = np.empty((self.shape[0] * self.shape[1], 2), np.int64)
        count = _descend(self._distance, factor, start[0], start[1], cells)
        return cells[:count].copy()

    def _flood(self, factor: UInt8Array, source: Cell, target: Cell | None, slack: int, directed: bool) -> bool:
        rows, columns = self.shape
        if not (0 <= source[0] < rows and 0 <= source[1] < columns):
            raise ValueError(f"cell {source} lies outside of the grid of {rows}x{columns} cells.")
        i, j = (-1, -1) if target is None else target
        last = (i + 1) * (columns + 2) + j + 1 if 0 <= i < rows and 0 <= j < columns else 0
        self._rimmed_factor[1:-1, 1:-1] = factor
        grid = (self._rimmed_factor.ravel(), self._rimmed_distance.ravel(), columns + 2)
        buffers = (self._reached, self._heads, self._entry_cell, self._entry_next)
        _forget(grid[1], self._reached[: self._reached_count])
        first = (source[0] + 1) * (columns + 2) + source[1] + 1
        found, self._reached_count = _flood(*grid, first, last, (i + 1, j + 1), slack, directed, *buffers)
        return bool(found)


def shortest_way_m(
    occupancy: OccupancyMap,
    radius_m: float,
    start_xy_m: tuple[float, float],
    goal_xy_m: tuple[float, float],
    *,
    goal_radius_m: float = 0.0,
) -> float:
    """Length of the shortest way of a disc to a circle around the goal [m]; inf if there is none.

    A grid path, pulled taut over free cells: within a few per cent of the true length.
    """
    points_m = shortest_path_m(occupancy, radius_m, start_xy_m, goal_xy_m)
    return math.inf if points_m is None else _length_until(points_m, goal_xy_m, goal_radius_m)


def shortest_path_m(
    occupancy: OccupancyMap, radius_m: float, start_xy_m: tuple[float, float], goal_xy_m: tuple[float, float]
) -> Float64Array | None:
    """Corner points of the shortest way of a disc [m], shape (M, 2); None if there is none or an end is off the map."""
    frame = occupancy.frame
    factor = np.where(clearance_m(occupancy) > radius_m, np.uint8(FREE), np.uint8(0))
    start, goal = frame.cell(*start_xy_m), frame.cell(*goal_xy_m)
    if not all(0 <= i < factor.shape[0] and 0 <= j < factor.shape[1] for i, j in (start, goal)):
        return None
    factor[start] = factor[goal] = FREE
    cells = GridSearch(occupancy.occupied.shape).path(factor, start, goal)
    return None if cells is None else taut_path_m(cells, factor, frame)


def taut_path_m(cells: Int64Array, factor: UInt8Array, frame: GridFrame) -> Float64Array:
    """A grid path with the corners that free ground does not need left out: corner points in the world [m], (M, 2)."""
    kept = np.empty(len(cells), np.int64)
    count = _pull_taut(cells, factor, kept)
    return np.array([frame.centre_m(int(i), int(j)) for i, j in cells[kept[:count]]])


def _length_until(points_m: Float64Array, goal_xy_m: tuple[float, float], radius_m: float) -> float:
    """Length of a polyline up to its first point within `radius_m` of the goal, in steps of 1 cm."""
    length, (gx, gy) = 0.0, goal_xy_m
    for (ax, ay), (bx, by) in zip(points_m[:-1].tolist(), points_m[1:].tolist(), strict=True):
        piece = math.hypot(bx - ax, by - ay)
        steps = max(1, math.ceil(piece / 0.01))
        for k in range(steps):
            t = k / steps
            if math.hypot(ax + t * (bx - ax) - gx, ay + t * (by - ay) - gy) <= radius_m:
                return length + t * piece
        length += piece
    return length


@kernel_with_cache
def _octile(di: int, dj: int) -> int:
    di, dj = abs(di), abs(dj)
    return 4 * (5 * max(di, dj) + 2 * min(di, dj))


@kernel_with_cache
def _forget(distance: Int32Array, reached: Int32Array) -> None:
    for cell in reached:
        distance[cell] = UNREACHED


@kernel_with_cache
def _flood(
    factor: UInt8Array,
    distance: Int32Array,
    width: int,
    first: int,
    last: int,
    target: Cell,
    slack: int,
    directed: bool,
    reached: Int32Array,
    heads: Int32Array,
    entry_cell: Int32Array,
    entry_next: Int32Array,
) -> tuple[bool, int]:
    """Fill the distances from a first cell; True if the last one is reached, and how many cells are.

    The grid has a blocked rim; factor and distance are flat, with rows of a width. `target` is the last cell's row
    and column, wherever it lies.
    """
    heads[:] = -1
    used, spare, waiting = 1, -1, 1
    reached[0], reached_count = first, 1
    distance[first] = 0
    key = _octile(first // width - target[0], first % width - target[1]) if directed else 0
    entry_cell[0] = first
    entry_next[0] = -1
    heads[key & _BUCKET_MASK] = 0
    limit = UNREACHED
    while waiting > 0 and key <= limit:
        bucket = key & _BUCKET_MASK
        while heads[bucket] >= 0:
            entry = heads[bucket]
            heads[bucket] = entry_next[entry]
            entry_next[entry] = spare
            spare = entry
            waiting -= 1
            cell = entry_cell[entry]
            here, up, right = distance[cell], 0, 0
            if directed:
                up, right = cell // width - target[0], cell % width - target[1]
            if here + (_octile(up, right) if directed else 0) != key:
                continue
            if cell == last:
                if directed:
                    return True, reached_count
                limit = min(limit, key + slack)
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    near = cell + di * width + dj
                    step = _STRAIGHT if di == 0 or dj == 0 else _DIAGONAL
                    candidate = here + step * int(factor[near])
                    if factor[near] == 0 or candidate >= distance[near]:
                        continue
                    if distance[near] == UNREACHED:
                        reached[reached_count] = near
                        reached_count += 1
                    distance[near] = candidate
                    free_entry = spare
                    if spare >= 0:
                        spare = entry_next[spare]
                    else:
                        free_entry = used
                        used += 1
                    onward = _octile(up + di, right + dj) if directed else 0
                    slot = (candidate + onward) & _BUCKET_MASK
                    entry_cell[free_entry] = near
                    entry_next[free_entry] = heads[slot]
                    heads[slot] = free_entry
                    waiting += 1
        key += 1
    return limit < UNREACHED, reached_count


@kernel_with_cache
def _descend(distance: Int32Array, factor: UInt8Array, i: int, j: int, cells: Int64Array) -> int:
    """Follow the distances down to 0; returns the number of cells."""
    height, width = distance.shape
    count = 0
    cells[0, 0], cells[0, 1] = i, j
    count = 1
    while distance[i, j] > 0:
        here, found = distance[i, j], False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                ii, jj = i + di, j + dj
                if found or ii < 0 or ii >= height or jj < 0 or jj >= width:
                    continue
                step = _STRAIGHT if di == 0 or dj == 0 else _DIAGONAL
                if distance[ii, jj] + step * int(factor[i, j]) == here and distance[ii, jj] < here:
                    found = True
                    cells[count, 0], cells[count, 1] = ii, jj
        assert found
        i, j = cells[count, 0], cells[count, 1]
        count += 1
    return count


@kernel_with_cache
def line_is_free(factor: UInt8Array, i0: float, j0: float, i1: float, j1: float, factor_max: int) -> bool:
    """True if cells of factor 1..factor_max cover a segment between two points in cell units (checked every 0.4)."""
    steps = math.ceil(max(abs(i1 - i0), abs(j1 - j0)) / 0.4) + 1
    for k in range(steps + 1):
        t = k / steps
        f = factor[int(i0 + t * (i1 - i0)), int(j0 + t * (j1 - j0))]
        if f == 0 or f > factor_max:
            return False
    return True


@kernel_with_cache
def _pull_taut(cells: Int64Array, factor: UInt8Array, kept: Int64Array) -> int:
    """Indices of the cells that remain corners; returns their number."""
    count, anchor = 1, 0
    kept[0] = 0
    for k in range(2, len(cells)):
        a, b = cells[anchor], cells[k]
        if not line_is_free(factor, a[0] + 0.5, a[1] + 0.5, b[0] + 0.5, b[1] + 0.5, FACTOR_MAX):
            anchor = k - 1
            kept[count] = anchor
            count += 1
    if len(cells) > 1:
        kept[count] = len(cells) - 1
        count += 1
    return count
