"""The assembly line as data, and the requests and replies of its stages: one message pair per handler.

A reply with a non-empty `rejected` says why the stage rejects the episode; `Stage.on_rejection` says whether the
episode continues all the same.
"""

import enum
import re
from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.messages.episode import EpisodeKey, Scenario
from readygo.common.messages.motion import EpisodeMotions
from readygo.common.messages.plan import RobotTrajectory


class OnRejection(enum.Enum):
    """What becomes of an episode that a stage rejects."""

    SKIP = "skip"
    """Its index is left out for good, and the next index takes its place."""
    KEEP = "keep"
    """It continues with the stage's result, in which later stages find the outcome."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Stage:
    """One station of the assembly line."""

    name: str
    """Part of the stage's topics, and its name in ledger and status."""
    role: str
    """Role of the workers that do the stage."""
    needs: tuple[str, ...] = ()
    """Names of the earlier stages whose results it gets, in this order."""
    on_rejection: OnRejection = OnRejection.SKIP
    records: bool = False
    """True if its results are samples that go to a recorder, whose commit completes the stage."""


HUMAN_PLAN = Stage(name="human-plan", role="human-planner")
ANIMATE = Stage(name="animate", role="animator", needs=(HUMAN_PLAN.name,))
ROBOT_PLAN = Stage(name="robot-plan", role="robot-planner", needs=(HUMAN_PLAN.name, ANIMATE.name))
RENDER = Stage(name="render", role="renderer", needs=(HUMAN_PLAN.name, ANIMATE.name, ROBOT_PLAN.name), records=True)
EXPERT_LINE = (HUMAN_PLAN, ANIMATE, ROBOT_PLAN, RENDER)
"""An expert among humans: the line of a run whose spec names no other."""
DRIVE = Stage(name="drive", role="driver", needs=(HUMAN_PLAN.name, ANIMATE.name), records=True)
DRIVE_LINE = (HUMAN_PLAN, ANIMATE, DRIVE)
"""A policy or the expert among humans, recorded with every outcome; the expert labels every state."""
EVALUATE = Stage(name="evaluate", role="evaluator", records=True)
EVALUATE_LINE = (EVALUATE,)
"""Every method through one episode; the process that keeps the results takes the recorder's role."""
STAGES = (*EXPERT_LINE, DRIVE, EVALUATE)
"""All stages that a run's spec may name."""


def check_stages(stages: Sequence[Stage]) -> None:
    """See whether stages make an assembly line.

    Raises:
        ValueError: If a name is there twice or no part of a topic, a need is no earlier stage, or not exactly the last
            stage records.
    """
    if [stage.records for stage in stages] != [False] * (len(stages) - 1) + [True]:
        raise ValueError("Exactly the last stage of a line must record.")
    if stages[-1].on_rejection is OnRejection.KEEP:
        raise ValueError(f"Stage {stages[-1].name!r} records: what it rejects cannot be kept.")
    earlier: set[str] = set()
    for stage in stages:
        if not re.fullmatch(r"[a-z0-9-]+", stage.name) or stage.name == "rec" or stage.name in earlier:
            raise ValueError(f"Stages must have different names of a-z, 0-9 and -, got {stage.name!r}.")
        if missing := sorted(set(stage.needs) - earlier):
            raise ValueError(f"Stage {stage.name!r} needs {missing[0]!r}, which is no earlier stage.")
        earlier.add(stage.name)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanPlanRequest:
    """Draw the start, the goal and the humans' trajectories of an episode."""

    episode: EpisodeKey
    static: bool = False
    """True leaves the humans out; start and goal stay those of the dynamic episode."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanPlanReply:
    """A scenario, or why there is none."""

    episode: EpisodeKey
    scenario: Scenario | None = None
    rejected: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AnimateRequest:
    """Move every human of a scenario along its trajectory."""

    scenario: Scenario


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AnimateReply:
    """Motions, or why there are none."""

    episode: EpisodeKey
    motions: EpisodeMotions | None = None
    rejected: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RobotPlanRequest:
    """Drive the expert through the scenario."""

    scenario: Scenario
    motions: EpisodeMotions


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RobotPlanReply:
    """The expert's run; `trajectory` is there for failed episodes too, with `rejected` naming the outcome."""

    episode: EpisodeKey
    trajectory: RobotTrajectory | None = None
    rejected: str = ""
