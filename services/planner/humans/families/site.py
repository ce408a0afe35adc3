"""What families of encounters draw on: one scene's maps and the settings."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeConfig
from readygo.common.maps import SightMap
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.config import Spacing
from readygo.services.planner.humans.passages import Passage, find_passages
from readygo.services.planner.humans.paths import HumanPathPlanner
from readygo.services.planner.humans.robot_task import ExpectedDrive, Point, RobotTask
from readygo.services.planner.humans.timing import Walk, first_rows

Encounter = tuple[Walk, ...]
"""Humans who meet the robot together."""

PASSAGE_WIDTH_MAX_M = 1.6
PASSAGE_WIDER_M = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Site:
    """One scene's maps and the settings. What is slow to make is computed when it is first asked for."""

    paths: HumanPathPlanner
    robot: RobotConfig
    episode: EpisodeConfig
    spacing: Spacing
    drive: ExpectedDrive
    find_sight: Callable[[], SightMap]
    """What hides humans from a camera: slow to make, so only asked for where a family needs it."""
    _on_way: dict[RobotTask, list[tuple[Point, float]]] = field(default_factory=dict, init=False)

    @cached_property
    def sight(self) -> SightMap:
        """What hides humans from a camera."""
        return self.find_sight()

    def sees(self, robot_m: Point, human_m: Point) -> bool:
        """True if a camera above the robot's centre there could see a human there, for any heading of the robot."""
        return self.sight.sees(*robot_m, self.robot.camera.mount_height_m, human_m)

    @cached_property
    def passages(self) -> tuple[Passage, ...]:
        """Where robot and human can hardly pass each other."""
        return find_passages(
            self.paths.clearance,
            self.paths.frame,
            walkable_m=self.spacing.route_clearance_m,
            width_max_m=PASSAGE_WIDTH_MAX_M,
            wider_m=PASSAGE_WIDER_M,
        )

    def passages_on_way(self, task: RobotTask) -> list[tuple[Point, float]]:
        """Middles of the passages that the robot's way leads through, and how far along the way they are [m]."""
        if task not in self._on_way:
            # Every draw of one task asks again; no draw asks about an earlier task.
            self._on_way.clear()
            self._on_way[task] = self._find_passages_on_way(task)
        return self._on_way[task]

    def _find_passages_on_way(self, task: RobotTask) -> list[tuple[Point, float]]:
        middles = np.array([passage.middle_m for passage in self.passages]).reshape(-1, 1, 2)
        gaps = middles - task.way_m
        squared = gaps[:, :, 0] ** 2 + gaps[:, :, 1] ** 2
        nearest = np.argmin(squared, axis=1).tolist()
        found = []
        for passage, row, k in zip(self.passages, squared, nearest, strict=True):
            along_m = task.length_m * k / (len(task.way_m) - 1)
            if row[k] < (0.5 * passage.width_m) ** 2 and 0.8 <= along_m <= task.length_m - 0.5:
                found.append((passage.middle_m, along_m))
        return found

    def speed_mps(self, rng: np.random.Generator) -> float:
        """A speed of the configured range."""
        return rng.uniform(self.episode.human_speed_min_mps, self.episode.human_speed_max_mps)

    def nearest_to_robot(self, task: RobotTask, xy_m: Float64Array) -> tuple[int, float]:
        """The step at which a human comes nearest to the robot's expected place, and how near [m]."""
        count = max(len(xy_m), math.ceil(self.drive.time_s(task.length_m) / DT_S) + 1)
        gap = first_rows(xy_m, count) - self.drive.rows(task, count)
        squared = gap[:, 0] ** 2 + gap[:, 1] ** 2
        step = int(np.argmin(squared))
        return step, math.sqrt(float(squared[step]))


Draw = Callable[[Site, np.random.Generator, RobotTask, int], Encounter]
"""Scene, source of chance, the robot's task, most humans that are wanted -> who comes; empty if there is no room."""
