"""Draws scenarios: where the robot starts and goes, and which humans meet it on the way."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from common.episode import EpisodeConfig, GridSearch, Purpose, episode_rng
from common.episode.grid_search import FREE, taut_path_m
from common.errors import AvatarError, SceneError
from common.maps import OccupancyMap, clearance_m
from common.messages import EpisodeKey, HumanTrajectory, Scenario
from common.robot import RobotConfig
from common.robot.kinematics import DT_S
from services.planner.config import HumanPlannerConfig
from services.planner.human import HumanPathPlanner
from services.planner.spline import at_constant_speed, length_m, resample

Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]
Point = tuple[float, float]

NO_WAY = "no way from start to goal"
NO_ROOM = "no room for a human"


class RejectedError(Exception):
    """An episode that cannot take place; the text is the short reason."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """Where the robot goes, and the taut way it is expected to take."""

    start_m: Point
    goal_m: Point
    way_m: Float64Array
    """Points every 5 cm or so from start to goal [m], shape (N, 2)."""


class ScenarioSampler:
    """Draws scenarios on one scene's maps."""

    def __init__(
        self,
        robot_map: OccupancyMap,
        human_map: OccupancyMap,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        config: HumanPlannerConfig,
        cell_margin_m: float,
    ) -> None:
        """Precompute free space and its connected regions.

        Raises:
            SceneError: If the robot's map has no free space for it.
        """
        self._robot, self._episode, self._config = robot, episode_config, config
        self._frame = robot_map.frame
        self._human_paths = HumanPathPlanner(human_map, config)
        clearance = clearance_m(robot_map)
        planning_m = robot.planning_radius_m + cell_margin_m
        self._factor = np.where(clearance > planning_m, np.uint8(FREE), np.uint8(0))
        region = ndimage.label(self._factor > 0, structure=np.ones((3, 3)))[0]
        self._region = np.where(clearance > planning_m + config.start_margin_m, region, 0)
        self._starts = np.flatnonzero(self._region)
        if len(self._starts) == 0:
            raise SceneError(
                f"The map has no free space for a disc of {robot.planning_radius_m} m; "
                "check the scene's scale and its maps."
            )
        self._search = GridSearch(self._factor.shape)

    def draw(self, episode: EpisodeKey, rng: np.random.Generator, avatar_names: list[str], *, static: bool) -> Scenario:
        """Draw a scenario; the static one has the dynamic one's start and goal.

        Raises:
            RejectedError: If the draw cannot take place.
            AvatarError: If humans are wanted but there are no avatars.
        """
        task = self._draw_task(rng)
        count = int(rng.integers(self._episode.human_count_min, self._episode.human_count_max + 1))
        humans: list[HumanTrajectory] = []
        if not static and count > 0:
            if not avatar_names:
                raise AvatarError("Humans are asked for but there are no avatars; add one or set human counts to 0.")
            # A stream of their own: who walks changes nothing about where.
            people = episode_rng(episode, Purpose.AVATAR)
            order = [avatar_names[int(k)] for k in people.permutation(len(avatar_names))]
            for k in range(count):
                humans.append(self._draw_human(rng, task, order[k % len(order)], humans))
        (x, y), (goal_x, goal_y) = task.start_m, task.goal_m
        return Scenario(
            episode=episode,
            start_xyyaw=np.array([x, y, math.atan2(goal_y - y, goal_x - x)]),
            goal_xy_m=np.array([goal_x, goal_y]),
            humans=tuple(humans),
        )

    def _draw_task(self, rng: np.random.Generator) -> Task:
        """Start and goal in one region, the distance drawn evenly from the config's range."""
        for _ in range(100):
            start = self._draw_start(rng)
            region = self._region[self._frame.cell(*start)]
            for _ in range(20):
                goal = self._draw_goal(rng, start)
                i, j = self._frame.cell(*goal)
                inside = 0 <= i < self._region.shape[0] and 0 <= j < self._region.shape[1]
                if not inside or self._region[i, j] != region:
                    continue
                way = self._way(start, goal)
                straight_m = math.hypot(goal[0] - start[0], goal[1] - start[1])
                if way is not None and length_m(way) <= self._config.detour_max * straight_m:
                    return Task(start_m=start, goal_m=goal, way_m=resample(way, int(length_m(way) / 0.05) + 2))
        raise RejectedError(NO_WAY)

    def _draw_start(self, rng: np.random.Generator) -> Point:
        cell = int(self._starts[int(rng.integers(len(self._starts)))])
        x, y = self._frame.centre_m(cell // self._region.shape[1], cell % self._region.shape[1])
        half = 0.49 * self._frame.resolution_m
        return x + rng.uniform(-half, half), y + rng.uniform(-half, half)

    def _draw_goal(self, rng: np.random.Generator, start: Point) -> Point:
        distance = rng.uniform(self._episode.goal_distance_min_m, self._episode.goal_distance_max_m)
        angle = rng.uniform(-math.pi, math.pi)
        return start[0] + distance * math.cos(angle), start[1] + distance * math.sin(angle)

    def _way(self, start: Point, goal: Point) -> Float64Array | None:
        cells = self._search.path(self._factor, self._frame.cell(*start), self._frame.cell(*goal))
        if cells is None:
            return None
        way = taut_path_m(cells, self._factor, self._frame)
        way[0], way[-1] = start, goal
        return way

    def _draw_human(
        self, rng: np.random.Generator, task: Task, avatar: str, others: list[HumanTrajectory]
    ) -> HumanTrajectory:
        """A human of a drawn encounter, or of the other kind where the place has no room for it."""
        crossing = rng.random() < self._config.crossing_share
        for encounter in ("crossing", "parallel") if crossing else ("parallel", "crossing"):
            for _ in range(self._config.attempts):
                speed = rng.uniform(self._episode.human_speed_min_mps, self._episode.human_speed_max_mps)
                draw = self._draw_crossing if encounter == "crossing" else self._draw_parallel
                path = draw(rng, task, speed)
                if path is None or not self._is_fair(path, task):
                    continue
                xy_m = at_constant_speed(path, speed, DT_S)
                if self._fits(xy_m, task, others):
                    return HumanTrajectory(avatar=avatar, encounter=encounter, speed_mps=speed, xy_m=xy_m)
        raise RejectedError(NO_ROOM)

    def _is_fair(self, path: Float64Array, task: Task) -> bool:
        (x0, y0), (x1, y1) = path[0].tolist(), path[-1].tolist()
        away = math.hypot(x0 - task.start_m[0], y0 - task.start_m[1]) >= self._config.start_distance_min_m
        parked = math.hypot(x1 - task.goal_m[0], y1 - task.goal_m[1]) >= self._config.parked_distance_min_m
        return away and parked and length_m(path) > 1.0

    def _draw_crossing(self, rng: np.random.Generator, task: Task, speed: float) -> Float64Array | None:
        """A path that crosses the robot's way, cut so that both are there at the same time."""
        config = self._config
        fraction = rng.uniform(config.crossing_fraction_min, config.crossing_fraction_max)
        low, high = math.radians(config.crossing_angle_min_deg), math.radians(config.crossing_angle_max_deg)
        angle = rng.uniform(low, high) * (1.0 if rng.random() < 0.5 else -1.0)
        meeting_s = fraction * length_m(task.way_m) / (config.robot_speed_fraction * self._robot.v_max_mps)
        getting_going_s = 0.5 * self._robot.v_max_mps / self._robot.a_max_mps2
        meeting_s = max(0.0, meeting_s + getting_going_s + rng.normal(0.0, config.meeting_jitter_s))
        before_m, after_m = min(max(speed * meeting_s, 1.5), 8.0), rng.uniform(2.0, 6.0)
        (x, y), (ux, uy) = _point_and_tangent(task.way_m, fraction)
        wx, wy = _turned(ux, uy, angle)
        before_m, after_m = (
            self._human_paths.reach_m((x, y), (-wx, -wy), before_m),
            self._human_paths.reach_m((x, y), (wx, wy), after_m),
        )
        if before_m < self._config.start_distance_min_m or after_m < 1.0:
            return None
        start, end = (x - wx * before_m, y - wy * before_m), (x + wx * after_m, y + wy * after_m)
        path = self._human_paths.path([start, (x, y), end])
        if path is None:
            return None
        return _cut_to_meet(path, (x, y), speed * meeting_s, slack_m=speed * 1.0)

    def _draw_parallel(self, rng: np.random.Generator, task: Task, speed: float) -> Float64Array | None:
        """A path beside the robot's way, with it or against it."""
        offset = rng.uniform(-self._config.parallel_offset_m, self._config.parallel_offset_m)
        same = rng.random() < 0.5
        way = task.way_m
        (sx, sy), (su, sv) = _point_and_tangent(way, 0.0)
        (gx, gy), (gu, gv) = _point_and_tangent(way, 1.0)

        def beside(x: float, y: float, u: float, v: float, forward: float) -> Point:
            return x + forward * u - offset * v, y + forward * v + offset * u

        if same:
            start = beside(sx, sy, su, sv, rng.uniform(1.0, 3.0))
            end = beside(gx, gy, gu, gv, rng.uniform(0.0, 2.0))
        else:
            start = beside(gx, gy, gu, gv, rng.uniform(-1.0, 2.0))
            end = beside(sx, sy, su, sv, -rng.uniform(0.0, 2.0))
        return self._human_paths.path([start, end])

    def _fits(self, xy_m: Float64Array, task: Task, others: list[HumanTrajectory]) -> bool:
        """True if the start is left in peace, humans keep off each other, and parked ones leave the robot a way."""
        early = xy_m[: round(self._config.start_peace_s / DT_S) + 1] - np.array(task.start_m)
        if np.min(early[:, 0] ** 2 + early[:, 1] ** 2) < self._config.start_peace_m**2:
            return False
        contact_m = 2 * self._episode.human_radius_m
        if any(_nearest_m(xy_m, other.xy_m) < contact_m for other in others):
            return False
        factor = self._factor.copy()
        keep_off_m = self._robot.planning_radius_m + self._episode.human_radius_m + 0.05
        for parked in (xy_m, *(other.xy_m for other in others)):
            self._fill_disc(factor, (float(parked[-1, 0]), float(parked[-1, 1])), keep_off_m, None)
        # Whoever ends at the robot's start arrives there after the robot has left.
        self._fill_disc(factor, task.start_m, 2 * keep_off_m, self._factor)
        start, goal = self._frame.cell(*task.start_m), self._frame.cell(*task.goal_m)
        return self._search.path(factor, start, goal) is not None

    def _fill_disc(self, factor: UInt8Array, centre: Point, radius_m: float, source: UInt8Array | None) -> None:
        """Set the cells within a disc to blocked, or to what they are in `source`."""
        resolution = self._frame.resolution_m
        i, j = self._frame.cell(*centre)
        reach = int(radius_m / resolution) + 1
        rows = slice(max(i - reach, 0), max(i + reach + 1, 0))
        columns = slice(max(j - reach, 0), max(j + reach + 1, 0))
        y = self._frame.origin_y_m + (np.arange(factor.shape[0])[rows, None] + 0.5) * resolution - centre[1]
        x = self._frame.origin_x_m + (np.arange(factor.shape[1])[None, columns] + 0.5) * resolution - centre[0]
        inside = x * x + y * y < radius_m * radius_m
        factor[rows, columns][inside] = 0 if source is None else source[rows, columns][inside]


def _point_and_tangent(way: Float64Array, fraction: float) -> tuple[Point, Point]:
    """Point at a fraction of an evenly sampled way, and the unit direction there, over half a metre."""
    last = len(way) - 1
    k = min(int(fraction * last), last)
    a, b = max(0, k - 5), min(last, k + 5)
    dx, dy = (way[b] - way[a]).tolist()
    norm = math.hypot(dx, dy)
    x, y = way[k].tolist()
    return (x, y), (dx / norm, dy / norm)


def _turned(x: float, y: float, angle_rad: float) -> Point:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * x - s * y, s * x + c * y


def _cut_to_meet(path: Float64Array, meeting: Point, before_m: float, *, slack_m: float) -> Float64Array | None:
    """The path without its first part, so that `before_m` remain to the meeting point; None if too little is there."""
    even = resample(path, int(length_m(path) / 0.05) + 2)
    gaps = (even[:, 0] - meeting[0]) ** 2 + (even[:, 1] - meeting[1]) ** 2
    nearest = int(np.argmin(gaps))
    spacing_m = length_m(even) / (len(even) - 1)
    surplus = int((nearest * spacing_m - before_m) / spacing_m)
    if surplus * spacing_m < -slack_m:
        return None
    return even[max(surplus, 0) :]


def _nearest_m(a: Float64Array, b: Float64Array) -> float:
    """Smallest distance of two humans at the same time [m]; the one who arrives stands still."""
    k = np.arange(max(len(a), len(b)))
    gap = a[np.minimum(k, len(a) - 1)] - b[np.minimum(k, len(b) - 1)]
    return float(np.sqrt(np.min(gap[:, 0] ** 2 + gap[:, 1] ** 2)))
