"""Who commands the robots in a closed loop."""

import enum
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.policy import Policy, PolicyMemory
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.eyes import Eyes, people_key


class Method(enum.Enum):
    """What drives the robot."""

    POLICY = "policy"
    EXPERT = "expert"
    """The planner that recorded the data: it knows the map."""
    STRAIGHT_LINE = "straight-line"
    """Turns to the goal and drives, blind."""


class Driver(Protocol):
    """Commands a batch of robots; episodes come and go between calls."""

    def start(self, simulation: EpisodeSimulation) -> None:
        """A new episode joins."""
        ...

    def stop(self, simulation: EpisodeSimulation) -> None:
        """An episode has ended."""
        ...

    def commands(self, simulations: Sequence[EpisodeSimulation]) -> list[tuple[float, float]]:
        """Commands (v [m/s], w [rad/s]) for the next step of each episode."""
        ...


class PolicyDriver:
    """Drives by what the policy sees through a renderer."""

    def __init__(self, policy: Policy, eyes: Eyes) -> None:
        self._policy, self._eyes = policy, eyes
        self._running: dict[int, tuple[PolicyMemory, str]] = {}

    def start(self, simulation: EpisodeSimulation) -> None:
        """A new episode joins, with an empty memory."""
        self._running[id(simulation)] = (self._policy.start(), people_key(simulation.motions))

    def stop(self, simulation: EpisodeSimulation) -> None:
        """An episode has ended."""
        del self._running[id(simulation)]

    def commands(self, simulations: Sequence[EpisodeSimulation]) -> list[tuple[float, float]]:
        """See `Driver.commands`."""
        memories, people = zip(*(self._running[id(simulation)] for simulation in simulations), strict=True)
        images = self._eyes.look(simulations, people)
        previous = np.array([(s.v_mps, s.w_radps) for s in simulations], dtype=np.float32)
        goals = np.array([s.goal_xy_robot_m for s in simulations], dtype=np.float32)
        actions = self._policy.step(memories, images, previous, goals)
        return [(v, w) for v, w in actions.tolist()]


class StraightLineDriver:
    """Turns to the goal and drives straight at it."""

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot

    def start(self, simulation: EpisodeSimulation) -> None:
        """Nothing to remember."""

    def stop(self, simulation: EpisodeSimulation) -> None:
        """Nothing to forget."""

    def commands(self, simulations: Sequence[EpisodeSimulation]) -> list[tuple[float, float]]:
        """See `Driver.commands`."""
        return [straight_line_command(simulation.goal_xy_robot_m, self._robot) for simulation in simulations]
