"""What the expert knows about a place: distances, cost factors, and the part of them that an episode needs."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, UInt8Array
from readygo.common.episode import EpisodeConfig, GridSearch
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL, UNREACHED
from readygo.common.maps import GridFrame, OccupancyMap, SightMap, clearance_m, sight_of_occupancy
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.config import CELL_MARGIN_M, ExpertConfig
from readygo.services.planner.expert.cost_factors import static_factor
from readygo.services.planner.expert.records import Obstacles

_WIDER_MARGIN_M = 15.0
_WINDOW_MARGINS_M = (6.0, _WIDER_MARGIN_M, math.inf)
_HEURISTIC_SLACK_M = 1.5
TIGHT_MARGIN_M = 0.03
"""Added to the robot's radius where no path keeps the planning radius [m]."""
HIGH_FACTOR = 40
"""Cost factor (in quarters) of narrow and of predicted ground when no path avoids it."""
WALL_COST = 0.5
"""Extra cost per metre right at the planning distance from a wall."""
WALL_DISTANCE_M = 0.2
"""Width of the strip that this cost falls off over [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeGround:
    """The part of a map around one episode."""

    margin_m: float
    """Distance that the part reaches around start and goal [m]; inf is the whole map."""
    frame: GridFrame
    occupancy: OccupancyMap
    """The map without inflated obstacles."""
    clearance: Float64Array
    """Distance to obstacles of the robot [m], shape (H, W)."""
    static_factor: UInt8Array
    """Cost factors that keep the planning radius, shape (H, W)."""
    tight_factor: UInt8Array
    """Cost factors with high cost, instead of blocked ground, between the robot's radius and the planning radius."""
    to_goal: Int32Array
    """Way to the goal over `static_factor`, UNITS_PER_CELL a cell, shape (H, W)."""
    goal_cell: tuple[int, int]
    human_frame: GridFrame
    human_factor: UInt8Array
    """Cost factors of what humans walk on, shape (H', W')."""
    human_places: tuple[tuple[int, int], ...]
    """Cells of the robot's start and goal for humans, who may be on their way there; empty in mode "paper"."""
    factor: UInt8Array
    """Memory for a search's factors, shape (H, W)."""
    heuristic: Int32Array
    """Memory for a search's distances, shape (H, W)."""
    search: GridSearch

    @cached_property
    def human_ways(self) -> tuple[Int32Array, ...]:
        """Ways of humans to `human_places`, UNITS_PER_CELL a cell, shape (H', W') each."""
        flood = GridSearch((self.human_factor.shape[0], self.human_factor.shape[1]))
        return tuple(flood.distances(self.human_factor, place) for place in self.human_places)

    def holds(self, x_m: float, y_m: float) -> bool:
        """True if a place lies in the window."""
        i, j = self.frame.cell(x_m, y_m)
        height, width = self.to_goal.shape
        return 0 <= i < int(height) and 0 <= j < int(width)

    @property
    def obstacles(self) -> Obstacles:
        """The map for compiled callers."""
        place = (self.frame.origin_x_m, self.frame.origin_y_m, self.frame.resolution_m)
        return Obstacles(self.occupancy.occupied, self.clearance, *place)

    def distances(self, factor: UInt8Array, x_m: float, y_m: float) -> bool:
        """Fill `heuristic` with the ways to the goal around the robot; False if it cannot reach the goal."""
        here = self.frame.cell(x_m, y_m)
        slack = int(_HEURISTIC_SLACK_M / self.frame.resolution_m * UNITS_PER_CELL)
        self.search.distances(factor, self.goal_cell, target=here, slack_units=slack, out=self.heuristic)
        return bool(self.heuristic[here] < UNREACHED)

    def way_out_rad(self, x_m: float, y_m: float, yaw_rad: float, goal_m: tuple[float, float]) -> float:
        """Bearing of the reachable cell within 0.5 m that is nearest to the goal [rad]."""
        i, j = self.frame.cell(x_m, y_m)
        reach = math.ceil(0.5 / self.frame.resolution_m)
        i0, j0 = max(0, i - reach), max(0, j - reach)
        window = self.to_goal[i0 : i + reach + 1, j0 : j + reach + 1]
        x, y = goal_m
        if window.size > 0 and int(window.min()) < UNREACHED:
            best = int(np.argmin(window))
            x, y = self.frame.centre_m(i0 + best // window.shape[1], j0 + best % window.shape[1])
        bearing = math.atan2(y - y_m, x - x_m) - yaw_rad
        return (bearing + math.pi) % (2 * math.pi) - math.pi


class SceneGround:
    """What all episodes in one scene share. Not thread-safe."""

    def __init__(
        self,
        robot_map: OccupancyMap,
        human_map: OccupancyMap,
        sight: SightMap | None,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        config: ExpertConfig,
    ) -> None:
        """Precompute distances and cost factors.

        Args:
            robot_map: What blocks the robot, not inflated.
            human_map: What blocks humans, not inflated; predictions keep off it.
            sight: What hides humans; None takes the robot's map.
            robot: Footprint, limits and camera.
            episode_config: Task and judging.
            config: How the expert drives.
        """
        self.occupancy, self.robot, self.config = robot_map, robot, config
        self.human_radius_m = episode_config.human_radius_m
        self.contact_m = robot.radius_m + episode_config.human_radius_m
        self.success_radius_m = episode_config.success_radius_m
        self.sight = sight_of_occupancy(robot_map) if sight is None else sight
        self.clearance = clearance_m(robot_map).astype(np.float64)
        self.human_frame = human_map.frame
        self.human_clearance = self.clearance if human_map is robot_map else clearance_m(human_map).astype(np.float64)
        keep_off = 1.0 + 4.0 * np.clip(1.0 - self.human_clearance, 0.0, 1.0) ** 2
        walkable = self.human_clearance > episode_config.human_radius_m
        self.human_factor = np.where(walkable, np.rint(FREE * keep_off), 0).astype(np.uint8)
        self.static_factor = static_factor(
            self.clearance,
            robot.planning_radius_m + CELL_MARGIN_M,
            wall_cost=WALL_COST,
            wall_distance_m=WALL_DISTANCE_M,
        )
        tight = (self.clearance > robot.radius_m + TIGHT_MARGIN_M) & (self.static_factor == 0)
        self.tight_factor = np.where(tight, np.uint8(HIGH_FACTOR), self.static_factor)

    def around(self, start_m: tuple[float, float], goal_m: tuple[float, float]) -> EpisodeGround:
        """The window that an episode takes place in: around start and goal [m], wider if that holds no way."""
        for margin_m in _WINDOW_MARGINS_M:
            window = self._window(start_m, goal_m, margin_m)
            if window.holds(*start_m) and window.to_goal[window.frame.cell(*start_m)] < UNREACHED:
                break
        return window

    def wider(
        self, local: EpisodeGround, start_m: tuple[float, float], goal_m: tuple[float, float]
    ) -> EpisodeGround | None:
        """A window for ways that do not fit into an episode's, around start and goal [m]; None if that is wide."""
        return self._window(start_m, goal_m, _WIDER_MARGIN_M) if local.margin_m < _WIDER_MARGIN_M else None

    def _window(self, start_m: tuple[float, float], goal_m: tuple[float, float], margin_m: float) -> EpisodeGround:
        part, moved = crop_grid(self.occupancy.frame, self.clearance.shape, start_m, goal_m, margin_m)
        factor = np.ascontiguousarray(self.static_factor[part])
        search = GridSearch((factor.shape[0], factor.shape[1]))
        goal = moved.cell(*goal_m)
        human_part, human_frame = crop_grid(self.human_frame, self.human_clearance.shape, start_m, goal_m, margin_m)
        asks_ways = self.config.mode != "paper" and not self.config.oracle
        return EpisodeGround(
            margin_m=margin_m,
            frame=moved,
            occupancy=OccupancyMap(frame=moved, occupied=np.ascontiguousarray(self.occupancy.occupied[part])),
            clearance=np.ascontiguousarray(self.clearance[part]),
            static_factor=factor,
            tight_factor=np.ascontiguousarray(self.tight_factor[part]),
            to_goal=search.distances(factor, goal),
            goal_cell=goal,
            human_frame=human_frame,
            human_factor=np.ascontiguousarray(self.human_factor[human_part]),
            human_places=tuple(human_frame.cell(*place) for place in (start_m, goal_m)) if asks_ways else (),
            factor=np.empty_like(factor),
            heuristic=np.empty(factor.shape, np.int32),
            search=search,
        )


def crop_grid(
    frame: GridFrame,
    shape: tuple[int, ...],
    start_m: tuple[float, float],
    goal_m: tuple[float, float],
    margin_m: float,
) -> tuple[tuple[slice, slice], GridFrame]:
    """The part of a grid around two points, and where it lies."""
    resolution = frame.resolution_m
    cells = math.ceil(min(margin_m, 1e6) / resolution)
    (i0, j0), (i1, j1) = frame.cell(*start_m), frame.cell(*goal_m)
    top, left = max(min(i0, i1) - cells, 0), max(min(j0, j1) - cells, 0)
    part = slice(top, min(max(i0, i1) + cells + 1, shape[0])), slice(left, min(max(j0, j1) + cells + 1, shape[1]))
    moved = GridFrame(
        origin_x_m=frame.origin_x_m + left * resolution,
        origin_y_m=frame.origin_y_m + top * resolution,
        resolution_m=resolution,
    )
    return part, moved
