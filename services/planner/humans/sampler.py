"""Draws scenarios: where the robot starts and goes, and which humans meet it on the way."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
from scipy import ndimage

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.episode import EpisodeConfig, Purpose, episode_rng
from readygo.common.episode.grid_search import FREE, taut_path_m
from readygo.common.errors import AvatarError, SceneError
from readygo.common.maps import OccupancyMap, SightMap, clearance_m, sight_of_occupancy
from readygo.common.messages import EpisodeKey, HumanTrajectory, Scenario
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.expert.config import CELL_MARGIN_M
from readygo.services.planner.humans.config import EFFORTS, SPACINGS, FamilyMix, HumanPlannerConfig
from readygo.services.planner.humans.families import FAMILIES, Encounter, Site
from readygo.services.planner.humans.paths import HumanPathPlanner, keeps_clear
from readygo.services.planner.humans.polyline import length_m, resample
from readygo.services.planner.humans.robot_task import SPACING_M, ExpectedDrive, Point, RobotTask, offset_point
from readygo.services.planner.humans.timing import Walk, nearest_m
from readygo.services.planner.humans.window_search import WindowSearch

PARKED_GAP_M = 0.05
"""Room beyond its planning radius that the robot keeps to a human who has arrived [m]."""
GROUP_GAP_M = 0.25
"""Room beyond its planning radius that the robot keeps to humans who stand from the beginning [m]."""

_ROBOT_SPEED_FRACTION = 0.85
"""Mean speed that crossings are timed for, as a share of v_max."""
_START_MARGIN_M = 0.10
"""Free space around the planning disc at start and goal [m]."""
_DETOUR_MAX = 3.0
"""Longest path to the goal, as a multiple of the straight distance."""
_START_PEACE_M = 0.75
"""Distance that `Spacing.start_peace_s` calls near [m]."""
_FAMILIES_TRIED = 4
"""Families that are tried for a human before there is no room."""
_NEARBY_M = 4.0
"""Ways around humans are looked for this near first [m]."""

STANDING = "standing"
"""Encounter of humans who stand in the robot's way or beside it for the whole episode."""
_STANDING_FRACTIONS = (0.2, 0.8)
"""Shares of the robot's way between which they stand."""
_STANDING_OFFSET_M = 0.6
"""Farthest from the way that they stand [m]."""

NO_WAY = "no way from start to goal"
NO_ROOM = "no room for a human"
IN_THE_WAY = "people in each other's way"


class RejectedError(Exception):
    """An episode that cannot take place; the text is the short reason."""


class ScenarioSampler:
    """Draws scenarios on one scene's maps."""

    def __init__(
        self,
        robot_map: OccupancyMap,
        human_map: OccupancyMap,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        config: HumanPlannerConfig,
        *,
        find_sight: Callable[[], SightMap] | None = None,
    ) -> None:
        """Precompute free space and its connected regions.

        Args:
            robot_map: What blocks the robot.
            human_map: What blocks humans.
            robot: Footprint and limits.
            episode_config: Distances, counts and speeds.
            config: How scenarios are drawn.
            find_sight: What hides humans from a camera; without it, all of the robot's map does.

        Raises:
            SceneError: If the robot's map has no free space for it.
        """
        self._robot, self._episode, self._config = robot, episode_config, config
        self._spacing = SPACINGS[config.spacing]
        self._frame = robot_map.frame
        self.site = Site(
            paths=HumanPathPlanner(human_map, self._spacing, iterations=EFFORTS[config.effort].iterations),
            robot=robot,
            episode=episode_config,
            spacing=self._spacing,
            drive=ExpectedDrive.of(robot, _ROBOT_SPEED_FRACTION),
            find_sight=find_sight or (lambda: sight_of_occupancy(robot_map)),
        )
        clearance = clearance_m(robot_map)
        planning_m = robot.planning_radius_m + CELL_MARGIN_M
        self._factor = np.where(clearance > planning_m, np.uint8(FREE), np.uint8(0))
        region = ndimage.label(self._factor > 0, structure=np.ones((3, 3)))[0]
        self._region = np.where(clearance > planning_m + _START_MARGIN_M, region, 0)
        self._starts = np.flatnonzero(self._region)
        if len(self._starts) == 0:
            raise SceneError(
                f"The map has no free space for a disc of {robot.planning_radius_m} m; "
                "check the scene's scale and its maps."
            )
        self._search = WindowSearch((self._factor.shape[0], self._factor.shape[1]))

    def draw(self, episode: EpisodeKey, rng: np.random.Generator, avatar_names: list[str], *, static: bool) -> Scenario:
        """Draw a scenario; the static one has the dynamic one's start and goal.

        Raises:
            RejectedError: If the draw cannot take place.
            AvatarError: If humans are wanted but there are no avatars.
        """
        task = self.draw_task(rng)
        count = int(rng.integers(self._episode.human_count_min, self._episode.human_count_max + 1))
        met: list[tuple[str, Walk]] = []
        if not static and (count > 0 or self._config.standing_max > 0):
            if not avatar_names:
                raise AvatarError("Humans are asked for but there are no avatars; add one or set human counts to 0.")
            met = self._draw_walking(rng, task, count)
            met += self._draw_standing(episode_rng(episode, Purpose.STANDING), task, [walk.xy_m for _, walk in met])
        # A separate random stream: the choice of avatars does not change the trajectories.
        order = episode_rng(episode, Purpose.AVATAR).permutation(len(avatar_names)).tolist()
        (x, y), (goal_x, goal_y) = task.start_m, task.goal_m
        return Scenario(
            episode=episode,
            start_xyyaw=np.array([x, y, math.atan2(goal_y - y, goal_x - x)]),
            goal_xy_m=np.array([goal_x, goal_y]),
            humans=tuple(
                HumanTrajectory(
                    avatar=avatar_names[order[k % len(order)]],
                    encounter=encounter,
                    speed_mps=walk.speed_mps,
                    xy_m=walk.xy_m,
                )
                for k, (encounter, walk) in enumerate(met)
            ),
        )

    def _draw_walking(self, rng: np.random.Generator, task: RobotTask, count: int) -> list[tuple[str, Walk]]:
        """Humans from the families of the mix, each with its family's name."""
        met: list[tuple[str, Walk]] = []
        while len(met) < count:
            drawn = self._draw_encounter(rng, task, count - len(met), [walk.xy_m for _, walk in met])
            if drawn is None:
                if self._config.fewer_humans and len(met) >= self._episode.human_count_min:
                    break
                raise RejectedError(NO_ROOM)
            family, walks = drawn
            met += [(family, walk) for walk in walks]
        return met

    def _draw_standing(
        self, rng: np.random.Generator, task: RobotTask, tracks: Sequence[Float64Array]
    ) -> list[tuple[str, Walk]]:
        """Humans who stand in the way or beside it; fewer than drawn where there is no room, at least `standing_min`.

        Args:
            rng: A separate stream: those who walk are the same with and without them.
            task: Start, goal and way of the robot.
            tracks: Trajectories of those who walk [m], shape (T, 2) each.
        """
        count = int(rng.integers(self._config.standing_min, self._config.standing_max + 1))
        standing: list[tuple[str, Walk]] = []
        for _ in range(EFFORTS[self._config.effort].attempts if count else 0):
            place, along = task.at(rng.uniform(*_STANDING_FRACTIONS))
            aside_m = rng.uniform(-_STANDING_OFFSET_M, _STANDING_OFFSET_M)
            walk = Walk(speed_mps=0.0, xy_m=np.array([offset_point(place, along, 0.0, aside_m)]))
            if self._fit((walk,), task, [*tracks, *(other.xy_m for _, other in standing)], GROUP_GAP_M):
                standing.append((STANDING, walk))
            if len(standing) == count:
                break
        if len(standing) < self._config.standing_min:
            raise RejectedError(NO_ROOM)
        return standing

    def draw_task(self, rng: np.random.Generator) -> RobotTask:
        """Start and goal in one region, the distance drawn evenly from the config's range.

        Raises:
            RejectedError: If there is none.
        """
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
                if way is not None and length_m(way) <= _DETOUR_MAX * straight_m:
                    return make_task(start, goal, way)
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
        # A taut way is shorter than its cells, by 8 % at most.
        longest = 1.1 * _DETOUR_MAX * math.dist(start, goal) / self._frame.resolution_m + 4
        cells = self._search.path(self._factor, self._frame.cell(*start), self._frame.cell(*goal), longest=longest)
        if cells is None:
            return None
        way = taut_path_m(cells, self._factor, self._frame)
        way[0], way[-1] = start, goal
        return way

    def _draw_encounter(
        self, rng: np.random.Generator, task: RobotTask, wanted: int, others: list[Float64Array]
    ) -> tuple[str, Encounter] | None:
        """People of a drawn family, or of another one of the mix where the place has no room for it, or None."""
        paths, effort = self.site.paths, EFFORTS[self._config.effort]
        for family in islice(drawn_order(rng, self._config.mix), _FAMILIES_TRIED):
            last = paths.searches + effort.searches
            for _ in range(effort.attempts):
                if paths.searches >= last:
                    break
                encounter = FAMILIES[family](self.site, rng, task, wanted)
                # Humans in conversation do not leave: the robot shall pass without touching their arms.
                gap_m = PARKED_GAP_M if len(encounter) == 1 else GROUP_GAP_M
                if encounter and self._fit(encounter, task, others, gap_m):
                    return family, encounter
        return None

    def _fit(self, encounter: Encounter, task: RobotTask, others: list[Float64Array], gap_m: float) -> bool:
        """True if humans who come together can join the others, and the robot can pass all with a gap [m]."""
        tracks = list(others)
        for walk in encounter:
            if not self._is_fair(walk.xy_m, task) or not self._fits(walk.xy_m, task, tracks):
                return False
            tracks.append(walk.xy_m)
        return self._leave_a_way(task, tracks, gap_m)

    def _is_fair(self, xy_m: Float64Array, task: RobotTask) -> bool:
        (x0, y0), (x1, y1) = xy_m[[0, -1]].tolist()
        away = math.hypot(x0 - task.start_m[0], y0 - task.start_m[1]) >= self._spacing.start_distance_min_m
        return away and math.hypot(x1 - task.goal_m[0], y1 - task.goal_m[1]) >= self._spacing.parked_distance_min_m

    def _fits(self, xy_m: Float64Array, task: RobotTask, others: list[Float64Array]) -> bool:
        """True if a human meets no wall, leaves the start in peace and keeps off the others."""
        early = xy_m[: round(self._spacing.start_peace_s / DT_S) + 1] - np.array(task.start_m)
        if np.min(early[:, 0] ** 2 + early[:, 1] ** 2) < _START_PEACE_M**2:
            return False
        radius_m = self._episode.human_radius_m
        if any(nearest_m(xy_m, other) < 2 * radius_m for other in others):
            return False
        return keeps_clear(self.site.paths.occupancy, xy_m, radius_m)

    def _leave_a_way(self, task: RobotTask, tracks: list[Float64Array], gap_m: float) -> bool:
        """True if the robot can get to its goal among humans who stand at the ends of their tracks."""
        keep_off_m = self._robot.planning_radius_m + self._episode.human_radius_m + gap_m
        parked = [track[-1] for track in tracks]
        gaps = [task.way_m - point for point in parked]
        # No human near the path: it is still free. A cell's diagonal and the way's spacing are on the safe side.
        clear_m = keep_off_m + 2 * self._frame.resolution_m + SPACING_M
        if all(np.min(gap[:, 0] ** 2 + gap[:, 1] ** 2) > clear_m * clear_m for gap in gaps):
            return True
        factor = self._factor.copy()
        for x, y in parked:
            self._fill_disc(factor, (float(x), float(y)), keep_off_m, None)
        # A human who ends at the robot's start arrives there after the robot has left.
        self._fill_disc(factor, task.start_m, 2 * keep_off_m, self._factor)
        start, goal = self._frame.cell(*task.start_m), self._frame.cell(*task.goal_m)
        return self._search.connects(factor, start, goal, margin=round(_NEARBY_M / self._frame.resolution_m))

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


def make_task(start: Point, goal: Point, way: Float64Array) -> RobotTask:
    """A task with its way in even steps."""
    even = resample(way, int(length_m(way) / SPACING_M) + 2)
    return RobotTask(start_m=start, goal_m=goal, way_m=even, length_m=length_m(even))


def drawn_order(rng: np.random.Generator, mix: FamilyMix) -> Iterator[str]:
    """All families of a mix, each drawn by its share among those that are left; what is not asked for is not drawn."""
    shares = mix.shares
    while shares:
        family = _draw_family(rng, shares) if len(shares) > 1 else next(iter(shares))
        del shares[family]
        yield family


def _draw_family(rng: np.random.Generator, shares: dict[str, float]) -> str:
    left = rng.random() * sum(shares.values())
    for family, share in shares.items():
        left -= share
        if left < 0:
            return family
    return next(reversed(shares))
