"""The expert teaches a state policy: it labels every state that the policy visits (DAgger).

Source: Ross, Gordon & Bagnell, A reduction of imitation learning and structured prediction to no-regret online
learning, 2011.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, run_episode
from readygo.common.messages import Split
from readygo.common.state_policy.state_driver import StateDriver, StateEpisode
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import StateWorld
from readygo.runs.scenarios import accepted_scenarios
from readygo.runs.world import World
from readygo.services.planner import Expert

AHEAD_S = 0.4
"""The label is what the expert plans to do in this time: the robot follows its commands late [s]."""
TAUGHT = 0.2
"""Share of the episodes that the expert drives after the first round."""
DISTURBED = 0.1
"""Chance that a random command replaces a decision of the expert, so that it shows how to recover."""


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """States and what the expert would do there."""

    told: Float32Array
    """Shape (S, I)."""
    shares: Float64Array
    """Commands in shares of the robot's limits, shape (S, 2)."""

    def joined(self, other: "Demonstrations") -> "Demonstrations":
        """Both."""
        return Demonstrations(np.concatenate([self.told, other.told]), np.concatenate([self.shares, other.shares]))


class Teacher:
    """Draws episodes of split train, one after the other, and labels what a policy does in them."""

    def __init__(self, world: World, seen: StateWorld, distances: GoalDistances) -> None:
        """Prepare a world.

        Args:
            world: World of a run.
            seen: The same for the state simulation.
            distances: Of the robot's map.
        """
        self._world, self._seen, self._distances = world, seen, distances
        self._episodes = accepted_scenarios(
            world.human_planner(react=False), world.animator(), world.spec.seed, Split.TRAIN, itertools.count()
        )
        self._rng = np.random.default_rng(world.spec.seed)

    def teach(self, policy: StatePolicy, count: int, *, alone: bool) -> Demonstrations:
        """Drive the next episodes and label every decision.

        Args:
            policy: Drives most of the episodes.
            count: Episodes.
            alone: True lets the expert drive all of them.
        """
        config, robot_map = self._world.config, self._world.scene.maps.robot
        driver = StateDriver(policy, self._seen, self._distances)
        told: list[Float32Array] = []
        labels: list[Command] = []
        for scenario, motions in itertools.islice(self._episodes, count):
            taught = alone or bool(self._rng.random() < TAUGHT)
            expert = self._world.robot_planner.expert(scenario, motions)
            lesson = _Lesson(driver, expert, partial(self._command, None if taught else policy))
            run_episode(EpisodeSimulation(scenario, motions, robot_map, config.robot, config.episode), lesson)
            told += lesson.told
            labels += lesson.labels
        shares = np.array(labels) / (config.robot.v_max_mps, config.robot.w_max_radps)
        return Demonstrations(np.concatenate(told), shares)

    def _command(self, policy: StatePolicy | None, told: Float32Array, label: Command) -> Command:
        """The decision of a policy, or without one that of the expert, with random commands in between."""
        if policy is not None:
            v, w = policy.choose(told)[0].tolist()
            return v, w
        if self._rng.random() < DISTURBED:
            robot = self._world.config.robot
            v, w = self._rng.uniform((0.0, -robot.w_max_radps), (robot.v_max_mps, robot.w_max_radps)).tolist()
            return v, w
        return label


class _Lesson:
    """Drives through one episode, and notes what it knows and the expert's label at every decision."""

    looks = False

    def __init__(self, driver: StateDriver, expert: Expert, choose: Callable[[Float32Array, Command], Command]) -> None:
        """Begin an episode.

        Args:
            driver: Tells what the robot knows.
            expert: Labels.
            choose: The decision, by what the robot knows and the label.
        """
        self._driver, self._expert, self._choose = driver, expert, choose
        self.told: list[Float32Array] = []
        self.labels: list[Command] = []

    def start(self, simulation: EpisodeSimulation) -> StateEpisode:
        """See `Driver.start`."""
        return self._driver.start(simulation)

    def act(self, running: Sequence[tuple[EpisodeSimulation, StateEpisode]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        ((one, episode),) = running
        self._driver.perceive(one, episode)
        if one.step % self._driver.hold_steps == 0:
            commands = self._expert.act(one).commands
            v, w = commands[min(one.clock.steps(AHEAD_S), len(commands) - 1)].tolist()
            self.told.append(self._driver.told(one, episode).copy())
            self.labels.append((v, w))
            episode.command = self._choose(self.told[-1], (v, w))
        else:
            self._expert.watch(one)
        return [episode.command]
