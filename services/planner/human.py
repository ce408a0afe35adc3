"""Where a human walks: a grid route that keeps off the walls, smoothed and timed."""

import itertools

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from common.episode import GridSearch
from common.episode.grid_search import FACTOR_MAX, FREE
from common.maps import OccupancyMap, clearance_m
from services.planner.config import HumanPlannerConfig
from services.planner.spline import length_m, smooth_path

Float64Array = npt.NDArray[np.float64]
Point = tuple[float, float]


class HumanPathPlanner:
    """Smooth paths over one human map; distances and components are computed once."""

    def __init__(self, occupancy: OccupancyMap, config: HumanPlannerConfig) -> None:
        self.frame = occupancy.frame
        self._config = config
        self._clearance = clearance_m(occupancy).astype(np.float64)
        walkable = self._clearance > config.route_clearance_m
        # Dear near walls: (1 + 4 pen^2), pen from 0 at 1 m to 1 at the wall.
        penalty = np.clip(1.0 - self._clearance, 0.0, 1.0)
        factor = np.minimum(np.rint(FREE * (1 + 4 * penalty * penalty)), FACTOR_MAX)
        self._factor = np.where(walkable, factor, 0).astype(np.uint8)
        self._component = ndimage.label(walkable, structure=np.ones((3, 3)))[0]
        self._search = GridSearch(walkable.shape)

    def component(self, point_m: Point) -> int:
        """Number of the connected walkable region that holds a point; 0 if nobody can walk there."""
        i, j = self.frame.cell(*point_m)
        inside = 0 <= i < self._component.shape[0] and 0 <= j < self._component.shape[1]
        return int(self._component[i, j]) if inside else 0

    def reach_m(self, point_m: Point, direction: Point, wanted_m: float) -> float:
        """A distance from a point in a (unit) direction at which one can stand [m]: the wanted one, or up to a wall."""
        region = self.component(point_m)

        def walkable(distance_m: float) -> bool:
            here = (point_m[0] + distance_m * direction[0], point_m[1] + distance_m * direction[1])
            return region > 0 and self.component(here) == region

        if walkable(wanted_m):
            return wanted_m
        step_m, count = 0.1, 0
        while walkable((count + 1) * step_m) and (count + 1) * step_m < wanted_m:
            count += 1
        return count * step_m

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
        route = self._route(via_m)
        straight_m = length_m(np.array(via_m))
        if route is None or length_m(route) > detour_max * straight_m + 0.5:
            return None
        config = self._config
        return smooth_path(
            route,
            self._clearance,
            self.frame,
            spacing_m=config.spline_spacing_m,
            preferred_m=config.preferred_clearance_m,
            required_m=config.clearance_m,
            factors=(config.obstacle_weight, config.jerk_weight, config.length_weight),
            iterations=config.iterations,
        )

    def _route(self, via_m: list[Point]) -> Float64Array | None:
        legs: list[Point] = [via_m[0]]
        for start, end in itertools.pairwise(via_m):
            cells = self._search.path(self._factor, self.frame.cell(*start), self.frame.cell(*end))
            if cells is None:
                return None
            legs += [self.frame.centre_m(i, j) for i, j in cells[1:-1].tolist()]
            legs.append(end)
        return np.array(legs)
