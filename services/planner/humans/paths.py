"""Where a human walks: a grid route that keeps off the walls, smoothed."""

import itertools
import math

import numpy as np
from scipy import ndimage

from readygo.common.arrays import BoolArray, Float64Array, Int32Array
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.episode.grid_search import FACTOR_MAX, FREE
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import OccupancyMap, clearance_m
from readygo.services.planner.humans.config import Spacing
from readygo.services.planner.humans.polyline import length_m
from readygo.services.planner.humans.robot_task import Point
from readygo.services.planner.humans.spline import smooth_path
from readygo.services.planner.humans.window_search import WindowSearch

_KNOT_SPACING_M = 0.4
"""Distance of the B-spline's control points [m]."""
_WEIGHTS = (200.0, 2.0, 0.02)
"""Weights of obstacles, jerk and length in the smoothing of a path."""


class HumanPathPlanner:
    """Smooth paths over one human map; distances and components are computed once."""

    def __init__(self, occupancy: OccupancyMap, spacing: Spacing, *, iterations: int) -> None:
        """Compute distances and components.

        Args:
            occupancy: What blocks humans.
            spacing: Distances to walls.
            iterations: Of the smoothing of a path.
        """
        self.frame = occupancy.frame
        self.occupancy, self._spacing, self._iterations = occupancy, spacing, iterations
        self.searches = 0
        """Paths that were asked for so far."""
        self._clearance = clearance_m(occupancy).astype(np.float64)
        walkable = self._clearance > spacing.route_clearance_m
        # Dear near walls: (1 + 4 pen^2), pen from 0 at 1 m to 1 at the wall.
        penalty = np.clip(1.0 - self._clearance, 0.0, 1.0)
        factor = np.minimum(np.rint(FREE * (1 + 4 * penalty * penalty)), FACTOR_MAX)
        self._factor = np.where(walkable, factor, 0).astype(np.uint8)
        self._component = ndimage.label(walkable, structure=np.ones((3, 3)))[0]
        self._search = WindowSearch((walkable.shape[0], walkable.shape[1]))

    @property
    def clearance(self) -> Float64Array:
        """Distance of each cell's centre to what blocks humans [m], shape (H, W)."""
        return self._clearance

    def component(self, point_m: Point) -> int:
        """Number of the connected walkable region that holds a point; 0 if no human can walk there."""
        i, j = self.frame.cell(*point_m)
        inside = 0 <= i < self._component.shape[0] and 0 <= j < self._component.shape[1]
        return int(self._component[i, j]) if inside else 0

    def reach_m(self, point_m: Point, direction: Point, wanted_m: float) -> float:
        """A distance from a point in a (unit) direction at which one can stand [m]: the wanted one, or up to a wall."""
        frame = self.frame
        place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
        return float(_reach_m(self._component, *place, point_m, direction, wanted_m))

    def nearest_walkable(self, point_m: Point, reach_m: float) -> Point | None:
        """A point if one can walk there, else the nearest walkable cell within a distance, else None."""
        if self.component(point_m):
            return point_m
        i, j = self.frame.cell(*point_m)
        cells = math.ceil(reach_m / self.frame.resolution_m)
        i0, j0 = max(i - cells, 0), max(j - cells, 0)
        rows, columns = np.nonzero(self._component[i0 : max(i + cells + 1, 0), j0 : max(j + cells + 1, 0)])
        if len(rows) == 0:
            return None
        x, y = self.frame.centre_m(rows + i0, columns + j0)
        gaps = (x - point_m[0]) ** 2 + (y - point_m[1]) ** 2
        best = int(np.argmin(gaps))
        return (float(x[best]), float(y[best])) if gaps[best] <= reach_m * reach_m else None

    def path(self, via_m: list[Point], *, detour_max: float = 1.6) -> Float64Array | None:
        """A smooth path through points that all lie in one walkable region.

        Args:
            via_m: Start, points to pass near, end [m].
            detour_max: A route longer than this many straight distances (plus 0.5 m) is refused.

        Returns:
            Points [m], shape (N, 2), or None if there is no such path.
        """
        components = {self.component(point) for point in via_m}
        if components == {0} or len(components) != 1:
            return None
        self.searches += 1
        longest_m = detour_max * length_m(np.array(via_m)) + 0.5
        route = self._route(via_m, longest_m)
        if route is None or length_m(route) > longest_m:
            return None
        return smooth_path(
            route,
            self._clearance,
            self.frame,
            spacing_m=_KNOT_SPACING_M,
            preferred_m=self._spacing.preferred_clearance_m,
            required_m=self._spacing.clearance_m,
            factors=_WEIGHTS,
            iterations=self._iterations,
        )

    def _route(self, via_m: list[Point], longest_m: float) -> Float64Array | None:
        """Grid route through points; None if there is none, or surely none of this length."""
        frame, straight_m = self.frame, length_m(np.array(via_m))
        legs = [np.array(via_m[:1])]
        for start, end in itertools.pairwise(via_m):
            longest = (longest_m - straight_m + math.dist(start, end)) / frame.resolution_m
            # A cell's diagonal at each end: the search goes from centre to centre.
            cells = self._search.path(self._factor, frame.cell(*start), frame.cell(*end), longest=longest + 2)
            if cells is None:
                return None
            inner = cells[1:-1] + 0.5
            x = frame.origin_x_m + inner[:, 1] * frame.resolution_m
            y = frame.origin_y_m + inner[:, 0] * frame.resolution_m
            legs += [np.stack([x, y], axis=1), np.array([end])]
        return np.concatenate(legs)


def keeps_clear(occupancy: OccupancyMap, xy_m: Float64Array, radius_m: float) -> bool:
    """True if a disc meets nothing at any of these places (N, 2) [m], by the definition of collisions."""
    frame = occupancy.frame
    place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    return bool(_keeps_clear(occupancy.occupied, *place, xy_m, radius_m))


@kernel_with_cache
def _reach_m(
    component: Int32Array,
    ox: float,
    oy: float,
    resolution: float,
    point: Point,
    direction: Point,
    wanted_m: float,
) -> float:
    height, width = component.shape
    i, j = math.floor((point[1] - oy) / resolution), math.floor((point[0] - ox) / resolution)
    region = component[i, j] if 0 <= i < height and 0 <= j < width else 0
    if region == 0:
        return 0.0
    best_m, count = 0.0, 0
    while True:
        # The wanted distance itself comes first.
        distance_m = wanted_m if count == 0 else count * 0.1
        if count > 0 and distance_m >= wanted_m:
            return best_m
        i = math.floor((point[1] + distance_m * direction[1] - oy) / resolution)
        j = math.floor((point[0] + distance_m * direction[0] - ox) / resolution)
        walkable = 0 <= i < height and 0 <= j < width and component[i, j] == region
        if count == 0 and walkable:
            return wanted_m
        if count > 0 and not walkable:
            return best_m
        best_m = count * 0.1
        count += 1


@kernel_with_cache
def _keeps_clear(occupied: BoolArray, ox: float, oy: float, resolution: float, xy: Float64Array, radius: float) -> bool:
    for row in range(len(xy)):
        if disc_meets_cells(occupied, ox, oy, resolution, xy[row, 0], xy[row, 1], radius):
            return False
    return True
