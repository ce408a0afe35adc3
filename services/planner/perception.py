"""What the expert may know about humans: those in its camera's view, and how they have moved there."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from common.maps import OccupancyMap
from common.robot.kinematics import DT_S
from services.planner.expert_config import ExpertConfig

Float64Array = npt.NDArray[np.float64]
Pose = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class PerceivedHuman:
    """A human as the expert knows it."""

    index: int
    """Which human of the episode."""
    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    seen: bool
    """True if in view now; else moved on from the latest view."""

    def ahead(self, count: int) -> Float64Array:
        """Positions after 1 .. `count` steps at constant velocity [m], shape (count, 2)."""
        t = np.arange(1, count + 1) * DT_S
        return np.stack([self.x_m + t * self.vx_mps, self.y_m + t * self.vy_mps], axis=1)


class HumanTracks:
    """Positions of the humans while they are in view."""

    def __init__(
        self, occupancy: OccupancyMap, horizontal_fov_deg: float, human_radius_m: float, config: ExpertConfig
    ) -> None:
        self._map, self._config = occupancy, config
        self._half_fov_rad = math.radians(horizontal_fov_deg) / 2
        self._radius_m = human_radius_m
        self._views: dict[int, list[tuple[int, float, float]]] = {}

    def observe(self, step: int, pose: Pose, human_xy_m: Float64Array) -> list[PerceivedHuman]:
        """Look once; call it at every step.

        Args:
            step: Simulation step.
            pose: Robot's x [m], y [m], yaw [rad].
            human_xy_m: Where the humans are, shape (N, 2).

        Returns:
            The humans in view, and those that left it less than `memory_s` ago.
        """
        perceived = []
        for index, (x, y) in enumerate(human_xy_m.tolist()):
            seen = self._is_visible(pose, x, y)
            if seen:
                self._remember(index, step, x, y)
            views = self._views.get(index)
            if not views or (not seen and (step - views[-1][0]) * DT_S > self._config.memory_s):
                continue
            vx, vy = self._velocity(views)
            elapsed_s = (step - views[-1][0]) * DT_S
            perceived.append(
                PerceivedHuman(
                    index=index,
                    x_m=views[-1][1] + vx * elapsed_s,
                    y_m=views[-1][2] + vy * elapsed_s,
                    vx_mps=vx,
                    vy_mps=vy,
                    seen=seen,
                )
            )
        return perceived

    def _is_visible(self, pose: Pose, x_m: float, y_m: float) -> bool:
        if not in_view(pose, x_m, y_m, self._half_fov_rad, self._config.range_m, self._radius_m):
            return False
        frame = self._map.frame
        return not self._config.needs_line_of_sight or bool(
            _sees(self._map.occupied, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, pose, x_m, y_m)
        )

    def _remember(self, index: int, step: int, x: float, y: float) -> None:
        views = self._views.setdefault(index, [])
        if views and views[-1][0] != step - 1:
            views.clear()
        views.append((step, x, y))
        del views[: -(round(self._config.velocity_window_s / DT_S) + 1)]

    @staticmethod
    def _velocity(views: list[tuple[int, float, float]]) -> tuple[float, float]:
        (first, x0, y0), (last, x1, y1) = views[0], views[-1]
        elapsed_s = max(last - first, 1) * DT_S
        return (x1 - x0) / elapsed_s, (y1 - y0) / elapsed_s


def in_view(pose: Pose, x_m: float, y_m: float, half_fov_rad: float, range_m: float, radius_m: float) -> bool:
    """True if some part of a disc at (x, y) lies in a robot's field of view and range.

    Args:
        pose: Robot's x [m], y [m], yaw [rad].
        x_m: Centre of the disc [m].
        y_m: Centre of the disc [m].
        half_fov_rad: Half of the horizontal field of view [rad].
        range_m: Largest distance of the centre [m].
        radius_m: Radius of the disc [m].
    """
    dx, dy = x_m - pose[0], y_m - pose[1]
    distance_m = math.sqrt(dx * dx + dy * dy)
    if distance_m > range_m:
        return False
    if distance_m <= radius_m:
        return True
    bearing_rad = (math.atan2(dy, dx) - pose[2] + math.pi) % (2 * math.pi) - math.pi
    return abs(bearing_rad) - math.asin(radius_m / distance_m) <= half_fov_rad


@njit(cache=True)
def _sees(
    occupied: npt.NDArray[np.bool_], ox: float, oy: float, resolution: float, pose: Pose, x: float, y: float
) -> bool:
    """True if no occupied cell lies on the line from the robot to a point."""
    dx, dy = x - pose[0], y - pose[1]
    steps = int(math.sqrt(dx * dx + dy * dy) / (0.5 * resolution)) + 1
    for k in range(steps + 1):
        i = math.floor((pose[1] + dy * k / steps - oy) / resolution)
        j = math.floor((pose[0] + dx * k / steps - ox) / resolution)
        if 0 <= i < occupied.shape[0] and 0 <= j < occupied.shape[1] and occupied[i, j]:
            return False
    return True
