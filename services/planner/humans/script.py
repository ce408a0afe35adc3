"""Plays scenario files: puts their starts, goals and humans on a scene's maps, or says which entry is wrong."""

import itertools
import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeConfig, GridSearch, Purpose, episode_rng, meets_obstacle
from readygo.common.episode.grid_search import FREE
from readygo.common.errors import ConfigError
from readygo.common.maps import OccupancyMap, clearance_m
from readygo.common.messages import EpisodeKey, HumanTrajectory, Scenario
from readygo.common.robot import RobotConfig
from readygo.services.planner.humans.paths import HumanPathPlanner, keeps_clear
from readygo.services.planner.humans.polyline import length_m
from readygo.services.planner.humans.robot_task import Point, apart_m
from readygo.services.planner.humans.scenario_file import ScenarioFile, ScriptedHuman, ScriptedScenario
from readygo.services.planner.humans.timing import time_path

_SETTLE_M = 0.3
"""A waypoint nearer to a wall than humans walk moves by at most this [m]."""
_GOAL_SNAP_M = 0.5
"""A scripted goal inside an obstacle moves to the nearest free place this near [m]."""
_DETOUR_MAX = 100.0
_STEP_MIN_M = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class ScriptMaps:
    """What scripts are checked against."""

    robot_map: OccupancyMap
    human_map: OccupancyMap
    paths: HumanPathPlanner


class Script:
    """The scenarios of a file on one scene, ready to be played by any episode."""

    def __init__(
        self,
        file: ScenarioFile,
        maps: ScriptMaps,
        robot: RobotConfig,
        episode: EpisodeConfig,
        avatar_names: Collection[str],
    ) -> None:
        """Place every entry.

        Args:
            file: The entries.
            maps: The scene's maps.
            robot: Footprint.
            episode: Radii and distances.
            avatar_names: Who may walk; empty if no avatar is loaded, because humans are left out.

        Raises:
            ConfigError: If an entry cannot take place; the message names file and entry.
        """
        self._maps, self._robot, self._episode = maps, robot, episode
        self._names = sorted(avatar_names)
        free = clearance_m(maps.robot_map) > robot.radius_m
        self._factor = np.where(free, np.uint8(FREE), np.uint8(0))
        self._search = GridSearch(maps.robot_map.occupied.shape)
        self._entries = []
        for number, entry in enumerate(file.entries):
            try:
                self._entries.append(self._place_entry(entry))
            except ValueError as error:
                raise ConfigError(f"{file.where(number)}: {error}") from error

    def scenario(self, episode: EpisodeKey, *, static: bool) -> tuple[Scenario, list[bool]]:
        """The scenario of an episode, and who of its humans may react: those who have waypoints."""
        start, goal, scripted = self._entries[episode.index % len(self._entries)]
        humans: list[HumanTrajectory] = []
        if not static and scripted:
            order = episode_rng(episode, Purpose.AVATAR).permutation(len(self._names))
            for k, (human, xy_m) in enumerate(scripted):
                humans.append(
                    HumanTrajectory(
                        avatar=human.avatar or self._names[int(order[k % len(order)])],
                        encounter=human.encounter,
                        speed_mps=human.speed_mps,
                        xy_m=xy_m,
                    )
                )
        scenario = Scenario(episode=episode, start_xyyaw=start, goal_xy_m=goal, humans=tuple(humans))
        return scenario, [bool(human.waypoints_m) for human, _ in scripted] if humans else []

    def _place_entry(
        self, entry: ScriptedScenario
    ) -> tuple[Float64Array, Float64Array, list[tuple[ScriptedHuman, Float64Array]]]:
        """Start pose, goal and humans of an entry; ValueError says what is wrong with it."""
        (x, y), robot_map = entry.start_m, self._maps.robot_map
        if meets_obstacle(robot_map, x, y, self._robot.radius_m):
            raise ValueError(f"start_m {_text((x, y))} is in an obstacle, or nearer to one than the robot's radius.")
        goal = self._free_goal((entry.goal_m[0], entry.goal_m[1]))
        if apart_m((x, y), goal) <= self._episode.success_radius_m:
            raise ValueError(f"the goal is within {self._episode.success_radius_m:g} m of the start: there is no way.")
        if not self._connects((x, y), goal):
            raise ValueError(f"no way leads the robot from {_text((x, y))} to {_text(goal)}.")
        yaw = math.atan2(goal[1] - y, goal[0] - x) if entry.yaw_rad is None else entry.yaw_rad
        humans = []
        for number, human in enumerate(entry.humans):
            try:
                humans.append((human, self._walk_positions(human, (x, y))))
            except ValueError as error:
                raise ValueError(f"humans[{number}]: {error}") from error
        return np.array([x, y, yaw]), np.array(goal), humans

    def _free_goal(self, goal: Point) -> Point:
        """The goal, or the nearest free place if it is in an obstacle and may move."""
        if not meets_obstacle(self._maps.robot_map, *goal, self._robot.radius_m):
            return goal
        x, y = self._maps.robot_map.frame.centre_m(*np.nonzero(self._factor))
        squared = (x - goal[0]) ** 2 + (y - goal[1]) ** 2
        if len(squared) and squared.min() <= _GOAL_SNAP_M * _GOAL_SNAP_M:
            best = int(np.argmin(squared))
            return float(x[best]), float(y[best])
        raise ValueError(f"goal_m {_text(goal)} is in an obstacle; nothing is free within {_GOAL_SNAP_M:g} m.")

    def _connects(self, start: Point, goal: Point) -> bool:
        frame, factor = self._maps.robot_map.frame, self._factor.copy()
        a, b = frame.cell(*start), frame.cell(*goal)
        # Free for the exact disc, perhaps not for one on the cell's centre.
        factor[a] = factor[b] = FREE
        return self._search.path(factor, a, b) is not None

    def _walk_positions(self, human: ScriptedHuman, start: Point) -> Float64Array:
        """Positions of a human at each step."""
        if human.avatar and self._names and human.avatar not in self._names:
            raise ValueError(f"unknown avatar {human.avatar!r}; there are {', '.join(self._names)}.")
        xy_m = human.xy_m if human.trajectory_m else self._along_waypoints(human)
        radius_m = self._episode.human_radius_m
        for row, (x, y) in enumerate(xy_m.tolist()):
            if not keeps_clear(self._maps.human_map, xy_m[row : row + 1], radius_m):
                what = "trajectory_m" if human.trajectory_m else "the walk"
                raise ValueError(f"{what} meets an obstacle at {_text((x, y))}, row {row}.")
        contact_m = self._robot.radius_m + radius_m
        if apart_m((float(xy_m[0, 0]), float(xy_m[0, 1])), start) < contact_m:
            raise ValueError(f"they start within {contact_m:g} m of the robot: this is a collision at once.")
        return xy_m

    def _along_waypoints(self, human: ScriptedHuman) -> Float64Array:
        paths = self._maps.paths
        via: list[Point] = []
        for number, (x, y) in enumerate(human.waypoints_m):
            blocked = meets_obstacle(self._maps.human_map, x, y, self._episode.human_radius_m)
            place = None if blocked else paths.nearest_walkable((x, y), _SETTLE_M)
            if place is None:
                raise ValueError(f"waypoints_m[{number}] {_text((x, y))} is in an obstacle or too near to one to walk.")
            if via and apart_m(via[-1], place) < _STEP_MIN_M:
                raise ValueError(f"waypoints_m[{number}] {_text((x, y))} is where the one before it is.")
            via.append(place)
        if len(via) == 1:
            return np.array(via)
        pauses = human.pauses_s or (0.0,) * len(via)
        # A human who stops at a waypoint may turn there; without a stop the path is smooth and passes near.
        stops = [0, *(k for k in range(1, len(via) - 1) if pauses[k] > 0), len(via) - 1]
        legs = []
        for first, last in itertools.pairwise(stops):
            leg = paths.path(via[first : last + 1], detour_max=_DETOUR_MAX)
            if leg is None:
                raise ValueError(f"no walk leads along waypoints_m {', '.join(map(_text, via[first : last + 1]))}.")
            legs.append(leg)
        ends = itertools.accumulate(length_m(leg) for leg in legs)
        return time_path(
            np.concatenate(legs),
            human.speed_mps,
            wait_s=pauses[0],
            pauses=[(end, pauses[k]) for end, k in zip(ends, stops[1:-1], strict=False)],
        )


def _text(point: Point) -> str:
    return f"({point[0]:g}, {point[1]:g})"
