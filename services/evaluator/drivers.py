"""Who commands the robots in a closed loop."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.policy import Policy, PolicyMemory
from readygo.services.evaluator.eyes import Eyes
from readygo.services.evaluator.goal_image import goal_image

POLICY, EXPERT, STRAIGHT_LINE = "policy", "expert", "straight-line"
"""Names of methods: the policy at hand; the planner that recorded its data and knows the map; a blind one."""


def short_name(method: str) -> str:
    """What tables call a method: a user's own by its class."""
    return method.rpartition(":")[2]


State = TypeVar("State")
"""What a driver remembers of one episode."""


@dataclass(frozen=True)
class DriverFailure:
    """In place of a command: the episode ends here."""

    reason: str


class Driver(Protocol[State]):
    """Commands a batch of robots; episodes come and go between calls, what is remembered goes with them."""

    looks: bool
    """True if it wants images: then episodes run side by side, for their views to share a request."""

    def start(self, simulation: EpisodeSimulation) -> State:
        """What there is to remember of a new episode."""
        ...

    def commands(self, running: Sequence[tuple[EpisodeSimulation, State]]) -> list[tuple[float, float] | DriverFailure]:
        """Commands (v [m/s], w [rad/s]) for the next step of each episode."""
        ...


@dataclass
class Ride:
    """What a policy's driver remembers of one episode."""

    memory: PolicyMemory
    command: tuple[float, float] = (0.0, 0.0)
    """The latest decision: v [m/s], w [rad/s]."""


class PolicyDriver:
    """Drives by what the policy sees through a renderer, every image of it, however seldom it decides."""

    looks = True

    def __init__(self, policy: Policy, eyes: Eyes, hold_steps: int = 1) -> None:
        """Prepare to drive.

        Args:
            policy: Who drives.
            eyes: Where its images come from.
            hold_steps: Steps from one decision to the next; the command is held in between.
        """
        self._policy, self._eyes, self._hold_steps = policy, eyes, hold_steps

    def start(self, simulation: EpisodeSimulation) -> Ride:
        """An empty memory, with an image of the goal where the policy wants one."""
        ride = Ride(self._policy.start(simulation.robot))
        if self._policy.spec.wants_goal_image:
            ride.memory.kept.goal_image = goal_image(self._eyes, simulation)
        return ride

    def commands(self, running: Sequence[tuple[EpisodeSimulation, Ride]]) -> list[tuple[float, float] | DriverFailure]:
        """See `Driver.commands`."""
        simulations, rides = zip(*running, strict=True)
        previous = np.array([(s.v_mps, s.w_radps) for s in simulations], dtype=np.float32)
        for ride, command in zip(rides, previous, strict=True):
            ride.memory.advance(command)
        looking = [(simulation, ride.memory) for simulation, ride in running if self._eyes.opens(simulation)]
        if looking:
            self._policy.see([memory for _, memory in looking], self._eyes.look([at for at, _ in looking]))
        goals = np.array([s.goal_xy_robot_m for s in simulations], dtype=np.float32)
        actions = self._policy.decide([ride.memory for ride in rides], previous, goals)
        for simulation, ride, (v, w) in zip(simulations, rides, actions.tolist(), strict=True):
            if simulation.step % self._hold_steps == 0:
                ride.command = (v, w)
        return [ride.command for ride in rides]


class StraightLineDriver:
    """Turns to the goal and drives straight at it."""

    looks = False

    def start(self, simulation: EpisodeSimulation) -> None:
        """Nothing to remember."""

    def commands(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[tuple[float, float] | DriverFailure]:
        """See `Driver.commands`."""
        return [straight_line_command(simulation.goal_xy_robot_m, simulation.robot) for simulation, _ in running]
