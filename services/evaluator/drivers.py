"""Who commands the robots in a closed loop."""

import enum
from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.policy import Policy, PolicyMemory
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.eyes import Eyes, humans_key


class Method(enum.Enum):
    """What drives the robot."""

    POLICY = "policy"
    EXPERT = "expert"
    """The planner that recorded the data: it knows the map."""
    STRAIGHT_LINE = "straight-line"
    """Turns to the goal and drives, blind."""


State = TypeVar("State")
"""What a driver remembers of one episode."""


class Driver(Protocol[State]):
    """Commands a batch of robots; episodes come and go between calls, what is remembered goes with them."""

    def start(self, simulation: EpisodeSimulation) -> State:
        """What there is to remember of a new episode."""
        ...

    def commands(self, running: Sequence[tuple[EpisodeSimulation, State]]) -> list[tuple[float, float]]:
        """Commands (v [m/s], w [rad/s]) for the next step of each episode."""
        ...


class Ride(NamedTuple):
    """What a policy's driver remembers of one episode."""

    memory: PolicyMemory
    people: str
    """Key of the episode's humans."""


class PolicyDriver:
    """Drives by what the policy sees through a renderer."""

    def __init__(self, policy: Policy, eyes: Eyes) -> None:
        self._policy, self._eyes = policy, eyes

    def start(self, simulation: EpisodeSimulation) -> Ride:
        """An empty memory."""
        return Ride(self._policy.start(), humans_key(simulation.motions))

    def commands(self, running: Sequence[tuple[EpisodeSimulation, Ride]]) -> list[tuple[float, float]]:
        """See `Driver.commands`."""
        simulations, rides = zip(*running, strict=True)
        images = self._eyes.look(simulations, [ride.people for ride in rides])
        previous = np.array([(s.v_mps, s.w_radps) for s in simulations], dtype=np.float32)
        goals = np.array([s.goal_xy_robot_m for s in simulations], dtype=np.float32)
        actions = self._policy.step([ride.memory for ride in rides], images, previous, goals)
        return [(v, w) for v, w in actions.tolist()]


class StraightLineDriver:
    """Turns to the goal and drives straight at it."""

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot

    def start(self, simulation: EpisodeSimulation) -> None:
        """Nothing to remember."""

    def commands(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[tuple[float, float]]:
        """See `Driver.commands`."""
        return [straight_line_command(simulation.goal_xy_robot_m, self._robot) for simulation, _ in running]
