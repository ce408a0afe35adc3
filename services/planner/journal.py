"""What the expert knew and intended while it drove, for those who want to know why it did what it did."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from common.messages import EpisodeMotions, RobotTrajectory, Scenario
from services.planner.expert import Decision
from services.planner.handlers import Planner, drive
from services.planner.perception import PerceivedHuman

Float64Array = npt.NDArray[np.float64]


@dataclass(kw_only=True, eq=False)
class Journal:
    """One entry per step of the expert's run."""

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
        """Steps at which another path came into force; the first path is the first change."""
        return tuple(
            step
            for step, path in enumerate(self.paths_m)
            if self.searched[step] and not _is_rest_of(path, self.paths_m[step - 1] if step else path[:0])
        )

    def seen(self, human: int) -> npt.NDArray[np.bool_]:
        """Where a human was in view, one flag per step."""
        return np.array([any(who.seen and who.index == human for who in row) for row in self.perceived], dtype=np.bool_)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpertRun:
    """One episode of the expert, and its journal."""

    scenario: Scenario
    motions: EpisodeMotions
    trajectory: RobotTrajectory
    journal: Journal

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


def run_with_journal(planner: Planner, scenario: Scenario, motions: EpisodeMotions) -> ExpertRun:
    """Drive the expert through a scenario, as `handle_robot_plan` does, and keep a journal.

    Raises:
        AvatarError: If a human's avatar is not loaded.
    """
    journal = Journal()
    trajectory = drive(planner, scenario, motions, observe=journal.note)
    return ExpertRun(scenario=scenario, motions=motions, trajectory=trajectory, journal=journal)


def _is_rest_of(path_m: Float64Array, old_m: Float64Array) -> bool:
    """True if a path is the end of another one: the robot has only moved on along it."""
    return len(path_m) <= len(old_m) and np.array_equal(path_m, old_m[len(old_m) - len(path_m) :])
