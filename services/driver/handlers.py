"""Closed loops that are recorded whoever drives and however they end, with what the expert would do at every state.

Expert and camera are protocols: who puts a driver together says what stands behind them.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages import Driver, EpisodeKey, RobotTrajectory
from readygo.common.policy import Policy
from readygo.common.robot import RobotConfig, limit_command
from readygo.services.driver.disturbance import Disturbance

AHEAD_S = 1.0
"""How far ahead the expert's commands are recorded beyond the one of now [s]."""
Commands = tuple[tuple[float, float], ...]
"""v [m/s], w [rad/s] over the next step and over every further one."""


class Advice(Protocol):
    """What an expert would do at a state, and what it knows there."""

    @property
    def commands(self) -> npt.NDArray[np.float64]:
        """Commands for the next steps: v [m/s], w [rad/s], shape (N, 2), N >= 1; the last one is held."""
        ...

    @property
    def replanned(self) -> bool:
        """True if it planned anew."""
        ...

    @property
    def cost(self) -> float:
        """Cost of its plan."""
        ...

    @property
    def visible(self) -> bool:
        """True if a human is in view."""
        ...


class Expert(Protocol):
    """Knows what to do at every state of one episode."""

    @property
    def replan_times_s(self) -> Sequence[float]:
        """CPU time of each replan so far [s]."""
        ...

    def act(self, simulation: EpisodeSimulation) -> Advice:
        """Advice for the simulation's present state; asked again at the same step, it is the same."""
        ...

    def watch(self, simulation: EpisodeSimulation) -> bool:
        """Look at the present state without deciding; True if a human is in view. One of both at every step."""
        ...


class Weigher(Protocol):
    """Says what would become of the robot under each command of a grid, see `Sample.risks`."""

    def risks(self, simulation: EpisodeSimulation) -> bytes:
        """Risks at the simulation's present state, one byte per command."""
        ...


class Camera(Protocol):
    """The robot's camera in one episode."""

    def take(self) -> npt.NDArray[np.uint8]:
        """The picture at the present step, sRGB, shape (H, W, 3)."""
        ...


class PolicyDriver:
    """A policy in one episode: it sees every picture as late as the robot's camera is."""

    def __init__(
        self,
        policy: Policy,
        robot: RobotConfig,
        image_every: int,
        goal_image: npt.NDArray[np.uint8] | None = None,
    ) -> None:
        """Begin an episode.

        Args:
            policy: Who drives.
            robot: What is driven: whose camera is so late, and which is commanded so often.
            image_every: Steps from picture to picture. Where these are more than the camera's, the policy decides only
                when it has a new one.
            goal_image: What the robot would see at its goal, where the policy wants to know: sRGB, shape (H, W, 3).
        """
        self._policy, self._memory, self._clock = policy, policy.start(robot), robot.clock
        self._memory.kept.goal_image = goal_image
        self._command = (0.0, 0.0)
        self._late_steps = self._clock.steps(robot.camera.latency_s)
        self._image_every, self._thinned = image_every, image_every > self._clock.image_every
        self._pictures: deque[tuple[int, npt.NDArray[np.uint8]]] = deque()

    def command(self, simulation: EpisodeSimulation, picture: npt.NDArray[np.uint8] | None) -> tuple[float, float]:
        """Command v [m/s], w [rad/s] for the next step.

        Args:
            simulation: The robot's state.
            picture: Of the present step, if one was taken; there is one at the first.
        """
        previous = np.array([(simulation.v_mps, simulation.w_radps)], dtype=np.float32)
        self._memory.advance(previous[0])
        if picture is not None:
            self._pictures.append((simulation.step, picture))
        looked = self._look(simulation.step)
        if looked or (not self._thinned and self._clock.commands(simulation.step)):
            goal = np.array([simulation.goal_xy_robot_m], dtype=np.float32)
            v, w = self._policy.decide([self._memory], previous, goal)[0].tolist()
            self._command = v, w
        return self._command

    def _look(self, step: int) -> bool:
        """See the picture that comes at a step, the first one until there is another; False where none comes."""
        if step > 0 and (step - self._late_steps) % self._image_every:
            return False
        while len(self._pictures) > 1 and self._pictures[1][0] <= step - self._late_steps:
            self._pictures.popleft()
        self._policy.see([self._memory], self._pictures[0][1][None])
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """One episode, driven."""

    trajectory: RobotTrajectory
    expert_commands: tuple[Commands, ...]
    """What the expert would have had the robot execute from each step on; `AHEAD_S` from the second on, none
    where no picture was taken."""
    risks: tuple[bytes, ...]
    """What would have become of the robot under each command of the grid at each step; empty without a picture."""


def driver_of(episode: EpisodeKey, mix: float) -> Driver:
    """Who drives an episode of a run in which a policy drives the share `mix`: drawn from a stream of its own."""
    return Driver.POLICY if episode_rng(episode, Purpose.DRIVER).random() < mix else Driver.EXPERT


def drive(
    simulation: EpisodeSimulation,
    expert: Expert,
    camera: Camera,
    weigher: Weigher,
    policy: PolicyDriver | None = None,
    disturbance: Disturbance | None = None,
    *,
    image_every: int = 1,
) -> Drive:
    """Drive an episode to its end; at every `image_every`-th step a picture is taken and the expert asked.

    In between a policy's command is held and the expert only watches, unless it drives.

    Args:
        simulation: The episode at its start.
        expert: Is asked, and drives if there is no policy.
        camera: Takes the pictures.
        weigher: Says what each command would lead to.
        policy: Drives if it is there.
        disturbance: Comes between the expert and the robot, where the expert drives.
        image_every: Steps from picture to picture.
    """
    log = _Log()
    would: list[Commands] = []
    while simulation.outcome is None:
        picture = camera.take() if simulation.step % image_every == 0 else None
        if picture is None and policy is not None:
            log.watched(expert.watch(simulation))
        else:
            advice = expert.act(simulation)
            would.append(executable(advice.commands, simulation))
            log.asked(advice, *((would[-1], weigher.risks(simulation)) if picture is not None else ((), b"")))
        if policy is not None:
            v, w = policy.command(simulation, picture)
        elif disturbance is not None:
            v, w = disturbance.command(would, simulation.clock.held_for(simulation.step))
        else:
            v, w = would[-1][simulation.clock.held_for(simulation.step) - 1]
        simulation.advance(v, w)
    trajectory = simulation.trajectory(
        human_visible=log.visible,
        replanned=log.replanned,
        expert_cost=log.costs,
        replan_times_s=expert.replan_times_s,
    )
    return Drive(trajectory=trajectory, expert_commands=tuple(log.would), risks=tuple(log.risks))


class _Log:
    """What the expert said at every step."""

    def __init__(self) -> None:
        self.visible: list[bool] = []
        self.replanned: list[bool] = []
        self.costs: list[float] = []
        self.would: list[Commands] = []
        self.risks: list[bytes] = []

    def asked(self, advice: Advice, would: Commands, risks: bytes) -> None:
        self._add(advice.visible, advice.replanned, advice.cost)
        self.would.append(would)
        self.risks.append(risks)

    def watched(self, visible: bool) -> None:
        self._add(visible, False, self.costs[-1])
        self.would.append(())
        self.risks.append(b"")

    def _add(self, visible: bool, replanned: bool, cost: float) -> None:
        self.visible.append(visible)
        self.replanned.append(replanned)
        self.costs.append(cost)


def executable(commands: npt.NDArray[np.float64], simulation: EpisodeSimulation) -> Commands:
    """What the robot would make of commands from its present state on, as many as are recorded.

    Args:
        commands: v [m/s], w [rad/s], shape (N, 2); the last one is held.
        simulation: The robot's state.
    """
    v, w = simulation.v_mps, simulation.w_radps
    executed, clock = [], simulation.clock
    for step in range(1 + clock.steps(AHEAD_S)):
        wanted_v, wanted_w = commands[min(step, len(commands) - 1)].tolist()
        v, w = limit_command(wanted_v, wanted_w, v, w, simulation.robot, clock.dt_s)
        executed.append((v, w))
    return tuple(executed)
