"""An evaluation that many workers drive: what it is, what is missing of an episode, and how a method did there."""

from dataclasses import dataclass
from typing import Any

from readygo.common.messages.checks import check_sha256
from readygo.common.messages.plan import RobotTrajectory


@dataclass(frozen=True, kw_only=True, slots=True)
class EvaluationPlanRequest:
    """Asks which tasks and methods are driven in this evaluation, and how."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EvaluationPlan:
    """What all episodes of an evaluation have in common, beside its `RunSpec`."""

    tasks: tuple[str, ...]
    methods: tuple[str, ...]
    control_hz: float | None
    """How often the policy decides [Hz]; None: as often as the robot is commanded."""
    camera: str
    """Camera through which the policy looks: "policy" or "robot"."""
    lockstep: int
    """Episodes that run side by side, for their views to share a request."""
    checkpoints: str
    """Folder of what was trained elsewhere."""
    method_hashes: dict[str, str]
    """SHA-256 by method, of those that are files: every worker must have the same files."""

    def __post_init__(self) -> None:
        for method, sha256 in self.method_hashes.items():
            check_sha256(f"method_hashes of {method[:100]!r}", sha256)


@dataclass(frozen=True, kw_only=True, slots=True)
class DrivesRequest:
    """Asks which drives are missing of an episode that is leased under this attempt."""

    index: int
    attempt: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Drive:
    """One method that drives in one task."""

    task: str
    method: str


@dataclass(frozen=True, kw_only=True, slots=True)
class DrivesReply:
    """The missing drives; an episode without any counts as done."""

    drives: tuple[Drive, ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class KeepRequest:
    """Result of a method in an episode: kept once, however often and by however many workers it is sent."""

    index: int
    attempt: int
    record: dict[str, Any]
    """A line of `episodes.jsonl`, as plain values."""
    trajectory: RobotTrajectory
