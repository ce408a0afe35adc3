"""What the expert knew and intended while it, or somebody else, drove: for those who want to know why it came so."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import EpisodeMotions, RobotTrajectory, Scenario
from readygo.services.planner.expert.handlers import RobotPlanner, drive
from readygo.services.planner.expert.interface import Decision
from readygo.services.planner.expert.perception import PerceivedHuman

Float64Array = npt.NDArray[np.float64]
Steer = Callable[[EpisodeSimulation], tuple[float, float]]
"""Commands v [m/s], w [rad/s] for the next step of an episode; called once at every step."""
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

    def seen(self, human: int) -> npt.NDArray[np.bool_]:
        """Where a human was in view, one flag per step."""
        return np.array([any(who.seen and who.index == human for who in row) for row in self.perceived], dtype=np.bool_)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenRun:
    """One episode, driven to its end, with the expert's journal: of what it did, or would have done."""

    scenario: Scenario
    motions: EpisodeMotions
    trajectory: RobotTrajectory
    journal: Journal
    driver: str = EXPERT
    """Who drove, in a word."""

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


def run_with_journal(planner: RobotPlanner, scenario: Scenario, motions: EpisodeMotions) -> DrivenRun:
    """Drive the expert through a scenario, as `handle_robot_plan` does, and keep a journal.

    Raises:
        AvatarError: If a human's avatar is not loaded.
    """
    journal = Journal()
    trajectory = drive(planner, scenario, motions, observe=journal.note)
    return DrivenRun(scenario=scenario, motions=motions, trajectory=trajectory, journal=journal)


def run_beside_expert(
    planner: RobotPlanner, scenario: Scenario, motions: EpisodeMotions, steer: Steer, driver: str
) -> DrivenRun:
    """Let somebody else drive through a scenario, and ask the expert at every step what it knows and would do.

    Args:
        planner: The expert's.
        scenario: Start, goal and humans.
        motions: How the humans move.
        steer: Who drives.
        driver: What to call it.

    Raises:
        AvatarError: If a human's avatar is not loaded.
    """
    journal, visible = Journal(), []
    simulation, expert = planner.simulation(scenario, motions), planner.expert(scenario, motions)
    while simulation.outcome is None:
        decision = expert.act(simulation)
        journal.note(decision)
        visible.append(decision.visible)
        simulation.advance(*steer(simulation))
    trajectory = simulation.trajectory(human_visible=visible)
    return DrivenRun(scenario=scenario, motions=motions, trajectory=trajectory, journal=journal, driver=driver)


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
