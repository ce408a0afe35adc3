"""Requests and replies of the assembly line's stages: one message pair per handler.

A reply with a non-empty `rejected` carries no result: the episode's index is skipped for that reason.
"""

from dataclasses import dataclass

from readygo.common.messages.episode import EpisodeKey, Scenario
from readygo.common.messages.motion import EpisodeMotions
from readygo.common.messages.plan import RobotTrajectory


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanPlanRequest:
    """Stage 1: draw the start, the goal and the humans' trajectories of an episode."""

    episode: EpisodeKey
    static: bool = False
    """True leaves the humans out; start and goal stay those of the dynamic episode."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanPlanReply:
    """Stage 1's result."""

    episode: EpisodeKey
    scenario: Scenario | None = None
    rejected: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AnimateRequest:
    """Stage 2: move every human of a scenario along its trajectory."""

    scenario: Scenario


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AnimateReply:
    """Stage 2's result."""

    episode: EpisodeKey
    motions: EpisodeMotions | None = None
    rejected: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RobotPlanRequest:
    """Stage 3: drive the expert through the scenario."""

    scenario: Scenario
    motions: EpisodeMotions


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RobotPlanReply:
    """Stage 3's result; `trajectory` is there for failed episodes too, with `rejected` naming the outcome."""

    episode: EpisodeKey
    trajectory: RobotTrajectory | None = None
    rejected: str = ""
