"""The lease protocol between workers, recorders and the coordinator.

An episode passes the stages in order; a worker claims the next one that waits for its stage and holds it under an
attempt number until it completes or the lease runs out. Late work carries an old attempt and is answered "stale".
"""

import enum
from dataclasses import dataclass
from typing import Any

from readygo.common.messages.episode import EpisodeKey, Split


class Stage(enum.Enum):
    """Stages of the assembly line, in order; the value is part of the topic."""

    HUMAN_PLAN = "human-plan"
    ANIMATE = "animate"
    ROBOT_PLAN = "robot-plan"
    RENDER = "render"


@dataclass(frozen=True, kw_only=True, slots=True)
class Blob:
    """A content-addressed result; `data` is empty when it is too large to travel along: ask "blob"."""

    sha256: str
    data: bytes = b""


@dataclass(frozen=True, kw_only=True, slots=True)
class BlobRequest:
    """Topic "blob": one chunk of a blob."""

    sha256: str
    offset: int = 0


@dataclass(frozen=True, kw_only=True, slots=True)
class BlobReply:
    """A chunk; `size` is the blob's whole size, -1 when the blob is unknown."""

    size: int
    data: bytes


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimRequest:
    """Topic "coord/{stage}/claim": a worker asks for work."""

    worker: str
    numeric_class: str = ""
    """What the bits of this worker's results depend on: backend, package versions, architecture."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimReply:
    """`status` is "lease", "wait" (ask again soon), "done" (the run is over) or "refused" (another numeric class)."""

    status: str
    episode: EpisodeKey | None = None
    attempt: int = 0
    ttl_s: float = 0.0
    """The lease ends this long after the claim or the latest renewal [s]."""
    inputs: tuple[Blob, ...] = ()
    """Encoded results of the earlier stages, in their order."""
    recorder: str = ""
    """Stage RENDER: the recorder to append to, topic "rec/{recorder}/append"."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RenewRequest:
    """Topic "coord/{stage}/renew": the worker is still at it."""

    worker: str
    index: int
    attempt: int


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteRequest:
    """Topic "coord/{stage}/complete": a stage's result, or why the episode is rejected."""

    worker: str
    index: int
    attempt: int
    result: bytes = b""
    rejected: str = ""
    """Reason; the same episode is then never tried again."""
    failed: str = ""
    """An error of the worker's; the episode is tried again a few times, then the run fails with this text."""
    cpu_s: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class GrantRequest:
    """Topic "coord/rec/grant": may this recorder make the episode durable under this attempt?"""

    recorder: str
    index: int
    attempt: int


@dataclass(frozen=True, kw_only=True, slots=True)
class DoneRequest:
    """Topic "coord/rec/done": the episode is durable in this shard. Sent again until it is acknowledged."""

    recorder: str
    index: int
    attempt: int
    shard: str
    sample_count: int


@dataclass(frozen=True, kw_only=True, slots=True)
class LostRequest:
    """Topic "coord/rec/lost": a granted episode did not become durable; it is rendered again."""

    recorder: str
    index: int
    reason: str
    """Empty: render the episode again. Otherwise the run fails with this text (a full disk, for example)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PendingRequest:
    """Topic "coord/rec/pending": which grants does the coordinator believe this recorder holds?"""

    recorder: str


@dataclass(frozen=True, kw_only=True, slots=True)
class PendingReply:
    """Indices that were granted to the recorder and not reported done."""

    indices: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """Answer to renew, complete, grant, done and lost: "ok", "stale" (another attempt holds it) or "done" (durable)."""

    status: str


@dataclass(frozen=True, kw_only=True, slots=True)
class StatusRequest:
    """Topic "ctl/status": how far is the run?"""


@dataclass(frozen=True, kw_only=True, slots=True)
class StatusReply:
    """Counts of episodes by state."""

    wanted: int
    committed: int
    samples: int
    waiting: dict[str, int]
    """Episodes that wait, by stage."""
    leased: dict[str, int]
    """Episodes that a worker holds, by stage."""
    rejected: dict[str, int]
    """Rejected indices by reason."""
    requeued: int
    """Leases that ended without a result."""
    cpu_s: dict[str, float]
    """CPU time of completed work by stage [s]."""
    finished: bool
    failed: str = ""
    """Why the run cannot be finished; empty while it can."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FileRef:
    """A file of the run that workers can fetch as a blob."""

    path: str
    """Path relative to its bundle, with forward slashes."""
    sha256: str
    size: int


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSpec:
    """Everything that fixes a run's samples, and where to find it."""

    run: str
    """Name of the run on the bus."""
    scene_path: str
    scene_hash: str
    scene_files: tuple[FileRef, ...]
    avatars_path: str
    """Folder or file of the avatars; empty for the embedded ones."""
    avatar_hashes: dict[str, str]
    """Content hash by avatar name."""
    seed: int
    split: Split
    static: bool
    """True leaves the humans out."""
    config: dict[str, Any]
    """Resolved sections: robot, episode, human_planner, expert, animator, renderer, recorder."""
    metadata: dict[str, Any]
    """Versions, commit and licenses, recorded with the data; not part of the identity."""
    scenarios: str = ""
    """Text of the scenario file that the episodes play; empty if they are drawn."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSpecRequest:
    """Topic "coord/spec": what is this run?"""


@dataclass(frozen=True, kw_only=True, slots=True)
class ControlRequest:
    """Topic "ctl": `command` is "pause", "resume" or "cancel"."""

    command: str
