"""Driving by a policy, in a simulation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.policy import Policy


class PolicyCamera(Protocol):
    """Where a policy's images come from, with the latency of the robot's camera."""

    def arrives(self, simulation: EpisodeSimulation) -> bool:
        """True if an image reaches the policy at the present step; at the first step one does."""
        ...

    def look(self, simulations: Sequence[EpisodeSimulation]) -> UInt8Array:
        """The images that reach the policy at the present steps, see `PolicySpec.images`, shape (B, H, W, C)."""
        ...

    def goal_image(self, simulation: EpisodeSimulation) -> UInt8Array:
        """What the robot would see at its goal without humans, sRGB, shape (H, W, 3)."""
        ...


@dataclass
class PolicyState:
    """What a policy's driver remembers of one episode."""

    memory: PolicyMemory
    command: Command = (0.0, 0.0)
    """The latest command: v [m/s], w [rad/s]."""


class PolicyDriver:
    """Drives by what a policy sees. It sees every image that arrives, however seldom it decides."""

    looks = True

    def __init__(self, policy: Policy, camera: PolicyCamera, hold_steps: int | None = 1) -> None:
        """Prepare to drive.

        Args:
            policy: Decides.
            camera: Where its images come from.
            hold_steps: Steps from one decision to the next, a multiple of the robot's steps between commands; its
                command is held in between. None decides when an image arrives.
        """
        self._policy, self._camera, self._hold_steps = policy, camera, hold_steps

    def start(self, simulation: EpisodeSimulation) -> PolicyState:
        """An empty memory, with an image of the goal if the policy wants one."""
        state = PolicyState(self._policy.start(simulation.robot))
        if self._policy.spec.wants_goal_image:
            state.memory.show_goal(self._camera.goal_image(simulation))
        return state

    def act(self, running: Sequence[tuple[EpisodeSimulation, PolicyState]]) -> list[Command | DriverFailure]:
        """Commands of the policy for one control step, as `Driver.act` returns them."""
        simulations, states = zip(*running, strict=True)
        previous = np.array([(s.v_mps, s.w_radps) for s in simulations], dtype=np.float32)
        for state, command in zip(states, previous, strict=True):
            state.memory.advance(command)
        seeing = [row for row, simulation in enumerate(simulations) if self._camera.arrives(simulation)]
        if seeing:
            images = self._camera.look([simulations[row] for row in seeing])
            self._policy.see([states[row].memory for row in seeing], images)
        adopting = self._adopting(simulations, seeing)
        # A policy whose graph decides at its own rate does so when an image arrives, adopted or not.
        if due := sorted({*seeing, *adopting}):
            goals = np.array([simulations[row].goal_xy_robot_m for row in due], dtype=np.float32)
            actions = self._policy.decide([states[row].memory for row in due], previous[due], goals)
            for row, (v, w) in zip(due, actions.tolist(), strict=True):
                if row in adopting:
                    states[row].command = (v, w)
        return [state.command for state in states]

    def _adopting(self, simulations: Sequence[EpisodeSimulation], seeing: Sequence[int]) -> set[int]:
        """Rows of the episodes in which the policy's decision becomes the command."""
        if self._hold_steps is None:
            return set(seeing)
        return {row for row, simulation in enumerate(simulations) if simulation.step % self._hold_steps == 0}
