"""Closed loops that are recorded for every driver and every outcome, with the expert's labels at every image."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Driver, DriverFailure, Observer, run_episode
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.errors import PolicyError
from readygo.common.messages import DriverKind as DriverName
from readygo.common.messages import EpisodeKey, RobotTrajectory
from readygo.common.robot import limit_command
from readygo.services.driver.disturbance import Disturbance
from readygo.services.driver.risks import RiskMap

AHEAD_S = 1.0
"""How far ahead the expert's commands are recorded beyond the one of now [s]."""
Commands = tuple[tuple[float, float], ...]
"""v [m/s], w [rad/s] over the next step and over every further one."""


class Advice(Protocol):
    """What an expert would do at a state, and what it knows there."""

    @property
    def commands(self) -> Float64Array:
        """Commands for the next steps: v [m/s], w [rad/s], shape (N, 2), N >= 1; the last one is held."""
        ...

    @property
    def replanned(self) -> bool:
        """True if the expert replanned."""
        ...

    @property
    def cost(self) -> float:
        """Cost of its plan."""
        ...

    @property
    def visible(self) -> bool:
        """True if a human is in view."""
        ...


class LabellingExpert(Protocol):
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


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeDrive:
    """One episode, driven."""

    trajectory: RobotTrajectory
    expert_commands: tuple[Commands, ...]
    """What the expert would have had the robot execute from each step on; `AHEAD_S` from the second on, none
    where no image was taken."""
    risks: tuple[bytes, ...]
    """What would have become of the robot under each command of the grid at each step; empty without an image."""


def driver_of(episode: EpisodeKey, mix: float) -> DriverName:
    """Driver of an episode in a run in which a policy drives the share `mix`, drawn from a dedicated random stream."""
    return DriverName.POLICY if episode_rng(episode, Purpose.DRIVER).random() < mix else DriverName.EXPERT


def drive(
    simulation: EpisodeSimulation,
    expert: LabellingExpert,
    weigher: RiskMap,
    driver: Driver[Any] | None = None,
    disturbance: Disturbance | None = None,
    *,
    camera: Observer | None = None,
    image_every: int = 1,
) -> EpisodeDrive:
    """Drive an episode to its end; at every `image_every`-th step the expert labels what the camera sees.

    Between two images the expert only watches, unless it drives.

    Args:
        simulation: The episode at its start.
        expert: Labels, and drives if there is no other driver.
        weigher: Says what each command would lead to.
        driver: Drives instead of the expert.
        disturbance: Comes between the expert and the robot, where the expert drives.
        camera: Takes the images.
        image_every: Steps from image to image.

    Raises:
        PolicyError: If the driver gave up.
    """
    labels = ExpertLabels(expert, weigher, image_every, drives=driver is None)
    observers = [labels] if camera is None else [camera, labels]
    run = run_episode(simulation, driver or LabelDriver(labels, disturbance), observers)
    if run.failure:
        raise PolicyError(f"The driver of {simulation.scenario.episode.episode_id} gave up: {run.failure}")
    return labels.drive(simulation)


class ExpertLabels(Observer):
    """What the expert would do at the states of an episode, and what every other command would lead to."""

    def __init__(self, expert: LabellingExpert, weigher: RiskMap, image_every: int, *, drives: bool) -> None:
        """Prepare an episode.

        Args:
            expert: Is asked.
            weigher: Says what each command would lead to.
            image_every: Steps from image to image: only there are labels and risks recorded.
            drives: True if the expert decides at every step.
        """
        self._expert, self._weigher, self._image_every, self._drives = expert, weigher, image_every, drives
        self._visible: list[bool] = []
        self._replanned: list[bool] = []
        self._costs: list[float] = []
        self._labels: list[Commands] = []
        self._risks: list[bytes] = []
        self.commands: list[Commands] = []
        """What the expert wanted at each step at which it decided, from there on."""

    def step(self, simulation: EpisodeSimulation) -> None:
        """Ask the expert."""
        labelled = simulation.step % self._image_every == 0
        if not (labelled or self._drives):
            self._note(self._expert.watch(simulation), False, self._costs[-1])
            return
        advice = self._expert.act(simulation)
        self.commands.append(executable(advice.commands, simulation))
        self._note(advice.visible, advice.replanned, advice.cost)
        if labelled:
            self._labels[-1], self._risks[-1] = self.commands[-1], self._weigher.risks(simulation)

    def drive(self, simulation: EpisodeSimulation) -> EpisodeDrive:
        """The episode, once it has ended."""
        trajectory = simulation.trajectory(
            human_visible=self._visible,
            replanned=self._replanned,
            expert_cost=self._costs,
            replan_times_s=self._expert.replan_times_s,
        )
        return EpisodeDrive(trajectory=trajectory, expert_commands=tuple(self._labels), risks=tuple(self._risks))

    def _note(self, visible: bool, replanned: bool, cost: float) -> None:
        self._visible.append(visible)
        self._replanned.append(replanned)
        self._costs.append(cost)
        self._labels.append(())
        self._risks.append(b"")


class LabelDriver:
    """The expert, driving by its labels, with or without a disturbance."""

    looks = False

    def __init__(self, labels: ExpertLabels, disturbance: Disturbance | None) -> None:
        """Prepare to drive.

        Args:
            labels: Observes the episode.
            disturbance: Comes between the expert and the robot.
        """
        self._labels, self._disturbance = labels, disturbance

    def start(self, simulation: EpisodeSimulation) -> None:
        """See `Driver.start`; the labels hold all state."""

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[tuple[float, float] | DriverFailure]:
        """See `Driver.act`; takes exactly one episode, which the labels observe."""
        ((simulation, _),) = running
        held, commands = simulation.clock.held_for(simulation.step), self._labels.commands
        if self._disturbance is not None:
            return [self._disturbance.command(commands, held)]
        return [commands[-1][held - 1]]


def executable(commands: Float64Array, simulation: EpisodeSimulation) -> Commands:
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
