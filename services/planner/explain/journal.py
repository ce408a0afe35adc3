"""What the expert knew and intended while it or another driver drove, to explain the run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Driver, Observer, run_episode
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeMotions, RobotTrajectory, Scenario
from readygo.services.planner.expert.handlers import RobotPlanner, drive
from readygo.services.planner.expert.interface import Decision, Expert
from readygo.services.planner.expert.perception import PerceivedHuman

EXPERT = "expert"
"""The driver of runs whose journal says why they went as they did."""

ANOTHER_WAY_M = 0.2
"""Plans that stay nearer to each other are the same way [m]."""


@dataclass(kw_only=True, eq=False)
class Journal:
    """One entry per step of a run."""

    paths_m: list[Float64Array] = field(default_factory=list)
    """What was left of the path in force after the step's decision [m], shape (N, 2) each; empty without a plan."""
    perceived: list[tuple[PerceivedHuman, ...]] = field(default_factory=list)
    """The humans that the expert knew of."""
    searched: list[bool] = field(default_factory=list)
    """True where a search ran."""

    def note(self, decision: Decision) -> None:
        """Add a step."""
        self.paths_m.append(decision.path_xy_m.copy())
        self.perceived.append(decision.perceived)
        self.searched.append(decision.replanned)

    @cached_property
    def changes(self) -> tuple[int, ...]:
        """Steps at which another way came into force: more than `ANOTHER_WAY_M` off; the first way is the first."""
        steps, nothing = [], np.empty((0, 2))
        for step, path in enumerate(self.paths_m):
            old = self.paths_m[step - 1] if step else nothing
            if self.searched[step] and len(path) and _apart_m(path, old) > ANOTHER_WAY_M:
                steps.append(step)
        return tuple(steps)

    @property
    def given_up(self) -> tuple[int, ...]:
        """The changes at which there was a way that was given up for the new one."""
        return tuple(step for step in self.changes if step > 0 and len(self.paths_m[step - 1]))

    def steps_in_view(self, human: int) -> BoolArray:
        """True at the steps at which a human was in view."""
        return np.array([any(who.seen and who.index == human for who in row) for row in self.perceived], dtype=np.bool_)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenRun:
    """One episode, driven to its end, with the expert's journal: of what it did, or would have done."""

    scenario: Scenario
    motions: EpisodeMotions
    trajectory: RobotTrajectory
    journal: Journal
    driver: str = EXPERT
    """Name of the driver, in a word."""

    @property
    def explained(self) -> bool:
        """True if the journal is of the one who drove."""
        return self.driver == EXPERT

    def human_xy_m(self, human: int) -> Float64Array:
        """Where a human was at each step of the run [m], shape (T, 2)."""
        motion = self.motions.humans[human].motion
        rows = np.minimum(np.arange(len(self.trajectory.xyyaw)), len(motion.root_m) - 1)
        xy_m: Float64Array = motion.root_m[rows, :2].astype(np.float64)
        return xy_m

    def gap_m(self, human: int) -> Float64Array:
        """Distance of the centres of the robot and a human at each step [m], shape (T,)."""
        offset = self.human_xy_m(human) - self.trajectory.xyyaw[:, :2]
        gap: Float64Array = np.sqrt(offset[:, 0] * offset[:, 0] + offset[:, 1] * offset[:, 1])
        return gap


class JournalKeeper(Observer):
    """Asks the expert at every step, regardless of the driver, and keeps the journal."""

    def __init__(self, expert: Expert) -> None:
        """Prepare an episode.

        Args:
            expert: The expert of the episode.
        """
        self._expert = expert
        self.journal = Journal()
        self.visible: list[bool] = []
        """True where a human was in view."""

    def step(self, simulation: EpisodeSimulation) -> None:
        """Add a step."""
        decision = self._expert.act(simulation)
        self.journal.note(decision)
        self.visible.append(decision.visible)


def run_with_journal(planner: RobotPlanner, scenario: Scenario, motions: EpisodeMotions) -> DrivenRun:
    """Drive the expert through a scenario, as `handle_robot_plan` does, and keep a journal.

    Raises:
        AvatarError: If a human's avatar is not loaded.
    """
    keepers: list[JournalKeeper] = []

    def observe(expert: Expert) -> list[JournalKeeper]:
        keepers.append(JournalKeeper(expert))
        return keepers

    trajectory = drive(planner, scenario, motions, observe)
    return DrivenRun(scenario=scenario, motions=motions, trajectory=trajectory, journal=keepers[0].journal)


def run_beside_expert(
    planner: RobotPlanner,
    scenario: Scenario,
    motions: EpisodeMotions,
    driver: Driver[Any],
    name: str,
    observers: Sequence[Observer] = (),
) -> DrivenRun:
    """Let another driver drive through a scenario, and ask the expert at every step what it knows and would do.

    Args:
        planner: The expert's.
        scenario: Start, goal and humans.
        motions: How the humans move.
        driver: Drives.
        name: What to call the driver.
        observers: Told of every state before the expert is.

    Raises:
        AvatarError: If a human's avatar is not loaded.
        RunError: If the driver gave up.
    """
    keeper = JournalKeeper(planner.expert(scenario, motions))
    run = run_episode(planner.simulation(scenario, motions), driver, [*observers, keeper])
    if run.failure:
        raise RunError(f"{name} gave up in {scenario.episode.episode_id}: {run.failure}")
    trajectory = run.simulation.trajectory(human_visible=keeper.visible)
    return DrivenRun(scenario=scenario, motions=motions, trajectory=trajectory, journal=keeper.journal, driver=name)


def _apart_m(a_m: Float64Array, b_m: Float64Array) -> float:
    """How far the shorter one of two paths leads away from the other one [m]; inf if one is empty."""
    if len(a_m) == 0 or len(b_m) == 0:
        return math.inf
    short, long = sorted((a_m, b_m), key=_length_m)
    offset = short[:, None] - long[None]
    return math.sqrt(float((offset[..., 0] ** 2 + offset[..., 1] ** 2).min(axis=1).max()))


def _length_m(path_m: Float64Array) -> float:
    step = np.diff(path_m, axis=0)
    return float(np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2).sum())
