"""Reconstructing a scene: what a worker claims, how far it is, and what it reports."""

from dataclasses import dataclass

RECONSTRUCTOR = "reconstructor"
"""The role of its workers."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ReconstructionClaim:
    """A worker asks for the job."""

    worker: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ReconstructionJob:
    """What a worker shall do; paths are the same on its machine as on that of the one who asks."""

    attempt: int = 0
    """Number of this attempt, from 1; 0: there is nothing to do now."""
    over: bool = False
    """Nothing will come any more: the worker may leave."""
    source: str = ""
    """A video, a folder of photos, or a folder with a COLMAP model."""
    out: str = ""
    """The scene bundle to make."""
    work: str = ""
    """Folder of the job's state."""
    license: str = ""
    config: str = ""
    """`ReconstructorConfig` as JSON."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ReconstructionProgress:
    """How far a job is."""

    attempt: int
    stage: str
    number: int
    """Number of the stage, from 1."""
    stages: int
    """Number of stages."""
    share: float
    """Finished share of the stage, 0..1."""
    words: str = ""
    picture: bytes = b""
    """PNG of what is being made, with the first message that comes after it is drawn."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ReconstructionReport:
    """A worker has done its job, or cannot."""

    worker: str
    attempt: int
    failed: str = ""
    """Why it cannot; empty: it is done."""
    report: str = ""
    """What came of it, as JSON."""
