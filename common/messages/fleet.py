"""State of a run's workers, for programs that monitor it."""

from dataclasses import dataclass

from readygo.common.messages.checks import check_printable


@dataclass(frozen=True, kw_only=True, slots=True)
class FleetRequest:
    """Asks the coordinator which processes work on the run."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HeldLease:
    """A lease that a worker holds."""

    stage: str
    index: int
    """Number of the episode in its run."""
    attempt: int
    held_s: float
    """Time since the lease began, or since the coordinator did [s]."""

    def __post_init__(self) -> None:
        check_printable("stage", self.stage)


@dataclass(frozen=True, kw_only=True, slots=True)
class WorkerState:
    """A process of the fleet, as the coordinator sees it."""

    role: str
    """Role of the process; empty if it holds a lease, but is not there (any more)."""
    name: str
    silent_s: float
    """Time since it asked, renewed or reported anything [s]; recorders, which claim nothing, are never heard."""
    done: int
    """Stages of episodes that it completed since the coordinator started."""
    failed: int
    """Stages of episodes that failed on it since the coordinator started."""
    holds: tuple[HeldLease, ...]

    def __post_init__(self) -> None:
        check_printable("role", self.role, empty=True)
        check_printable("name", self.name)


@dataclass(frozen=True, kw_only=True, slots=True)
class FleetReply:
    """The fleet as the coordinator sees it."""

    stages: tuple[str, ...]
    """The run's stages in their order."""
    workers: tuple[WorkerState, ...]
    """All workers, sorted by role and name."""
    done_per_minute: dict[str, float]
    """Episodes that passed a stage in the last minute, by stage."""

    def __post_init__(self) -> None:
        for stage in (*self.stages, *self.done_per_minute):
            check_printable("stages", stage)
