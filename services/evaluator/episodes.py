"""The episodes of an evaluation: the same starts, goals and humans for every method."""

import dataclasses
import enum
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from readygo.common.bus import Bus
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.grid_search import shortest_way_m
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import SceneError
from readygo.common.maps import OccupancyMap
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    EpisodeMotions,
    HumanPlanRequest,
    Scenario,
    Split,
    topics,
)
from readygo.common.robot import RobotConfig

REQUEST_TIMEOUT_S = 120.0
"""Longest wait for one reply [s]."""
REJECTED_MAX = 1000
"""Rejected scenarios in a row after which the scene is called unusable."""


class Task(enum.Enum):
    """What an episode asks of the robot."""

    STATIC = "static"
    """Reach the goal without humans."""
    DYNAMIC = "dynamic"
    """Reach the goal among walking people."""
    REACTIVE = "reactive"
    """Reach the goal among the same people, who yield to the robot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedEpisode:
    """One episode that every method drives through."""

    task: Task
    scenario: Scenario
    motions: EpisodeMotions
    shortest_m: float
    """Shortest way to the circle of success around the goal [m], people aside."""


Simulate = Callable[[MatchedEpisode], EpisodeSimulation]
"""Starts the simulation of an episode."""


class EpisodeSource:
    """Draws episodes from planner and animator."""

    def __init__(
        self,
        bus: Bus,
        *,
        robot: RobotConfig,
        robot_map: OccupancyMap,
        episode_config: EpisodeConfig,
    ) -> None:
        self._bus = bus
        self._robot, self._robot_map = robot, robot_map
        self._episode_config = episode_config

    def draw(self, *, seed: int, split: Split, count: int, tasks: Sequence[Task]) -> tuple[list[MatchedEpisode], int]:
        """The first `count` indices whose dynamic scenario is accepted, each as every task, and the number of skipped.

        Whether an index counts never depends on how a method does in it, nor on the tasks that are asked for: the
        static task drives between the starts and goals of the dynamic one.

        Raises:
            SceneError: If the planner rejects scenario after scenario.
        """
        episodes: list[MatchedEpisode] = []
        skipped, keys = 0, (EpisodeKey(seed=seed, split=split, index=index) for index in itertools.count())
        for _ in range(count):
            dynamic, rejected = self.next_accepted(keys)
            skipped += rejected
            episodes += [as_task(dynamic, task) for task in tasks]
        return episodes, skipped

    def next_accepted(self, keys: Iterator[EpisodeKey]) -> tuple[MatchedEpisode, int]:
        """The dynamic episode of the first key whose scenario is accepted, and the number of those rejected before it.

        Raises:
            SceneError: If the planner rejects scenario after scenario.
        """
        reason = ""
        for rejected, key in enumerate(itertools.islice(keys, REJECTED_MAX)):
            episode, reason = self.among_humans(key)
            if episode is not None:
                return episode, rejected
        raise SceneError(f"The last {REJECTED_MAX} scenarios were rejected ({reason}); look at the maps.")

    def among_humans(self, key: EpisodeKey) -> tuple[MatchedEpisode | None, str]:
        """The dynamic episode of a key; or None, and why it was rejected."""
        plan = self._bus.request(topics.HUMAN_PLAN, HumanPlanRequest(episode=key), timeout_s=REQUEST_TIMEOUT_S)
        if plan.rejected or plan.scenario is None:
            return None, plan.rejected
        animate = AnimateRequest(scenario=plan.scenario)
        animated = self._bus.request(topics.ANIMATE, animate, timeout_s=REQUEST_TIMEOUT_S)
        if animated.rejected or animated.motions is None:
            return None, animated.rejected
        episode = MatchedEpisode(
            task=Task.DYNAMIC,
            scenario=plan.scenario,
            motions=animated.motions,
            shortest_m=self._shortest_m(plan.scenario),
        )
        return episode, ""

    def _shortest_m(self, scenario: Scenario) -> float:
        start_x, start_y, _ = scenario.start_xyyaw.tolist()
        goal_x, goal_y = scenario.goal_xy_m.tolist()
        return shortest_way_m(
            self._robot_map,
            robot_of_episode(self._robot, scenario.episode).radius_m,
            (start_x, start_y),
            (goal_x, goal_y),
            goal_radius_m=self._episode_config.success_radius_m,
        )


def as_task(dynamic: MatchedEpisode, task: Task) -> MatchedEpisode:
    """An episode among humans as another task."""
    if task is not Task.STATIC:
        return dataclasses.replace(dynamic, task=task)
    scenario = dataclasses.replace(dynamic.scenario, humans=())
    return dataclasses.replace(dynamic, task=task, scenario=scenario, motions=EpisodeMotions(humans=()))
