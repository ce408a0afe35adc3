"""The expert teaches a state policy: it labels every state that the policy visits (DAgger).

Source: Ross, Gordon & Bagnell, A reduction of imitation learning and structured prediction to no-regret online
learning, 2011.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import AnimateRequest, EpisodeKey, EpisodeMotions, HumanPlanRequest, Scenario, Split
from readygo.common.state_policy.state_driver import StateDriver
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import StateWorld
from readygo.runs.world import World
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import HumanPlanner, handle_human_plan

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
        self._episodes = _accepted(world, world.human_planner(react=False), world.animator())
        self._rng = np.random.default_rng(world.spec.seed)

    def teach(self, policy: StatePolicy, count: int, *, alone: bool) -> Demonstrations:
        """Drive the next episodes and label every decision.

        Args:
            policy: Drives most of the episodes.
            count: Episodes.
            alone: True lets the expert drive all of them.
        """
        driver = StateDriver(policy, self._seen, self._distances)
        told: list[Float32Array] = []
        labels: list[tuple[float, float]] = []
        for scenario, motions in itertools.islice(self._episodes, count):
            taught = alone or bool(self._rng.random() < TAUGHT)
            self._drive(driver, None if taught else policy, scenario, motions, told, labels)
        robot = self._world.config.robot
        shares = np.array(labels) / (robot.v_max_mps, robot.w_max_radps)
        return Demonstrations(np.concatenate(told), shares)

    def _drive(
        self,
        driver: StateDriver,
        policy: StatePolicy | None,
        scenario: Scenario,
        motions: EpisodeMotions,
        told: list[Float32Array],
        labels: list[tuple[float, float]],
    ) -> None:
        """Drive one episode; without a policy the expert drives, with random commands in between."""
        config = self._world.config
        one = EpisodeSimulation(scenario, motions, self._world.scene.maps.robot, config.robot, config.episode)
        expert, episode = self._world.robot_planner.expert(scenario, motions), driver.start(one)
        ahead, command = one.clock.steps(AHEAD_S), (0.0, 0.0)
        while one.outcome is None:
            driver.perceive(one, episode)
            if one.step % driver.hold_steps == 0:
                commands = expert.act(one).commands
                v, w = commands[min(ahead, len(commands) - 1)].tolist()
                told.append(driver.told(one, episode).copy())
                labels.append((v, w))
                command = self._command(policy, told[-1], (v, w))
            else:
                expert.watch(one)
            one.advance(*command)

    def _command(
        self, policy: StatePolicy | None, told: Float32Array, label: tuple[float, float]
    ) -> tuple[float, float]:
        if policy is not None:
            v, w = policy.choose(told)[0].tolist()
            return v, w
        if self._rng.random() < DISTURBED:
            robot = self._world.config.robot
            v, w = self._rng.uniform((0.0, -robot.w_max_radps), (robot.v_max_mps, robot.w_max_radps)).tolist()
            return v, w
        return label


def _accepted(world: World, planner: HumanPlanner, animator: Animator) -> Iterator[tuple[Scenario, EpisodeMotions]]:
    for index in itertools.count():
        key = EpisodeKey(seed=world.spec.seed, split=Split.TRAIN, index=index)
        scenario = handle_human_plan(planner, HumanPlanRequest(episode=key)).scenario
        motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions if scenario else None
        if scenario is not None and motions is not None:
            yield scenario, motions
