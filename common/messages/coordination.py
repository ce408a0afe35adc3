"""The lease protocol between workers, recorders and the coordinator.

An episode passes the stages in order; a worker claims the next one that waits for its stage and holds it under an
attempt number until it completes or the lease runs out. Late work carries an old attempt and is answered "stale".
"""

import enum
import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from readygo.common.messages.checks import NAME_MAX, check_printable, check_relative_path, check_sha256
from readygo.common.messages.codec import OMITTED_WHEN_DEFAULT
from readygo.common.messages.episode import EpisodeKey, Split
from readygo.common.messages.stages import EXPERT_LINE, Stage, check_stages


class ClaimStatus(enum.Enum):
    """What became of a claim."""

    LEASE = "lease"
    WAIT = "wait"
    """Nothing waits for the stage now: ask again soon."""
    DONE = "done"
    """The run is over."""
    REFUSED = "refused"
    """The worker is of another numeric class than the run, or does not say of which."""


class VerdictStatus(enum.Enum):
    """What the coordinator says to a report."""

    OK = "ok"
    STALE = "stale"
    """The episode belongs to another attempt or another recorder."""
    DONE = "done"
    """The episode is durable already."""


class TeacherKind(enum.Enum):
    """Kinds of teachers."""

    STATE_POLICY = "state-policy"
    EXPERT_TRACKED = "expert-tracked"
    """The expert that knows people by tracks of simulated detections."""


FILE_BYTES_MAX = 2**36
"""No file of a run is larger [bytes]; the largest are scenes of some gigabytes."""


class Command(enum.Enum):
    """What an operator wants of a run."""

    PAUSE = "pause"
    RESUME = "resume"
    CANCEL = "cancel"


@dataclass(frozen=True, kw_only=True, slots=True)
class Blob:
    """A content-addressed result; `data` is empty when it is too large to travel along: send a `BlobRequest`."""

    sha256: str
    data: bytes = b""

    def __post_init__(self) -> None:
        check_sha256("sha256", self.sha256)


@dataclass(frozen=True, kw_only=True, slots=True)
class BlobRequest:
    """Asks for one chunk of a blob."""

    sha256: str
    offset: int = 0

    def __post_init__(self) -> None:
        check_sha256("sha256", self.sha256)


@dataclass(frozen=True, kw_only=True, slots=True)
class BlobReply:
    """A chunk; `size` is the blob's whole size, -1 when the blob is unknown."""

    size: int
    data: bytes


@dataclass(frozen=True, kw_only=True, slots=True)
class FileRef:
    """A file of the run that workers can fetch as a blob."""

    path: str
    """Path relative to its bundle, with forward slashes."""
    sha256: str
    size: int
    """Size [bytes], at most `FILE_BYTES_MAX`."""

    def __post_init__(self) -> None:
        check_relative_path("path", self.path)
        check_sha256("sha256", self.sha256)
        if not 0 <= self.size <= FILE_BYTES_MAX:
            raise ValueError(f"size must be 0..{FILE_BYTES_MAX} bytes, got {self.size}.")


def files_digest(files: Iterable[FileRef]) -> str:
    """SHA-256 over the names and hashes of files, in any order."""
    lines = sorted(f"{file.path} {file.sha256}" for file in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyRef:
    """A policy that drives in a run; the one of a run that learns is empty at first: others are offered to it."""

    path: str
    """Its folder on the machine that began the run; empty if its files are blobs alone."""
    files: tuple[FileRef, ...]
    """All that it is loaded from; none while there is no policy yet."""
    mix: float
    """Share of the episodes that it drives, 0..1; the expert drives the others."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.mix <= 1.0:
            raise ValueError(f"mix must be 0..1, got {self.mix}.")

    @property
    def sha256(self) -> str:
        """SHA-256 over the names and hashes of the files, in any order."""
        return files_digest(self.files)


@dataclass(frozen=True, kw_only=True, slots=True)
class TeacherRef:
    """Who labels a run's samples instead of the expert, and drives the expert's episodes."""

    path: str
    """Folder of a state policy on the machine that began the run; empty without files."""
    files: tuple[FileRef, ...]
    """All that a state policy is loaded from."""
    kind: TeacherKind = field(default=TeacherKind.STATE_POLICY, metadata=OMITTED_WHEN_DEFAULT)

    def __post_init__(self) -> None:
        if self.kind is not TeacherKind.STATE_POLICY and (self.path or self.files):
            raise ValueError(f"A teacher of the kind {self.kind.value!r} has no files, got {len(self.files)} files.")

    @property
    def sha256(self) -> str:
        """SHA-256 over the names and hashes of the files, in any order."""
        return files_digest(self.files)

    @property
    def name(self) -> str:
        """What names it in a run's identity: the hash of a state policy, or its kind."""
        return self.sha256 if self.kind is TeacherKind.STATE_POLICY else self.kind.value


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimRequest:
    """A worker asks for work."""

    worker: str
    numeric_class: str = ""
    """What the bits of this worker's results depend on: backend, package versions, architecture."""
    role: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Role under which the worker announced itself on the bus."""
    session: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Session of the worker's presence on the bus, from `Bus.announce`: its leases end with that session; empty where
    they end by time alone."""

    def __post_init__(self) -> None:
        check_printable("worker", self.worker)
        check_printable("role", self.role, empty=True)
        check_printable("session", self.session, empty=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimReply:
    """A lease, or why there is none."""

    status: ClaimStatus
    episode: EpisodeKey | None = None
    attempt: int = 0
    ttl_s: float = 0.0
    """The lease ends this long after the claim or the latest renewal [s]."""
    inputs: tuple[Blob, ...] = ()
    """Encoded results of the stages that this one needs, in the order of `Stage.needs`."""
    recorder: str = ""
    """The recorder to append to, for a stage that records."""
    policy: PolicyRef | None = field(default=None, metadata=OMITTED_WHEN_DEFAULT)
    """The offered policy that drives this episode if its draw says so, for a stage that records; None where none was
    offered: the run's own drives then, see `RunSpec.policy`."""
    lease: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Secret that proves that the worker holds the lease; the coordinator tells it to no other process."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Wake:
    """There may be work again: workers that wait may ask at once."""

    stages: tuple[str, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """Stages whose workers are woken; empty: of all stages."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RenewRequest:
    """The worker still works on an episode: its lease is to be prolonged."""

    worker: str
    index: int
    attempt: int
    lease: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Secret of the lease, from `ClaimReply.lease`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteRequest:
    """A stage's result, or why the episode is rejected."""

    worker: str
    index: int
    attempt: int
    result: bytes = b""
    rejected: str = ""
    """Why the stage rejects the episode; `Stage.on_rejection` says what becomes of it."""
    failed: str = ""
    """The worker's error; the episode is started again a few times, then it is set aside with this text."""
    cpu_s: float = 0.0
    lease: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Secret of the lease, from `ClaimReply.lease`."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.cpu_s < math.inf:
            raise ValueError(f"cpu_s must be a time, got {self.cpu_s}.")


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectRequest:
    """Asks whether an attempt, whose samples have come, is leased, and this recorder is to take them."""

    recorder: str
    episode: EpisodeKey
    attempt: int
    lease: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Secret of the lease that the sender of the samples gave, from `AppendRequest.lease`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class GrantRequest:
    """Asks whether this recorder may make the episode durable under this attempt."""

    recorder: str
    index: int
    attempt: int


@dataclass(frozen=True, kw_only=True, slots=True)
class DoneRequest:
    """The episode is durable in this shard. Sent again until it is acknowledged."""

    recorder: str
    index: int
    attempt: int
    shard: str
    sample_count: int
    policy: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """SHA-256 of the offered policy that drove, as in `EpisodeHeader.policy`; empty if it was none."""

    def __post_init__(self) -> None:
        if self.sample_count < 1:
            raise ValueError(f"a durable episode has samples, got a count of {self.sample_count}.")
        check_sha256("policy", self.policy, empty=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class LostRequest:
    """A granted episode did not become durable."""

    recorder: str
    index: int
    reason: str
    """Why the run fails, for example a full disk; empty: the episode is made again."""
    attempt: int = field(default=-1, metadata=OMITTED_WHEN_DEFAULT)
    """Attempt whose grant is taken back; -1: none is taken back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TroubleRequest:
    """What keeps a recorder from recording, until it says that nothing does any more."""

    recorder: str
    reason: str
    """What keeps the recorder from recording; empty: it records again."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PendingRequest:
    """Asks which grants the coordinator believes this recorder to hold."""

    recorder: str


@dataclass(frozen=True, kw_only=True, slots=True)
class PendingReply:
    """Indices that were granted to the recorder and not reported done."""

    attempts: tuple[int, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """Attempts under which they were granted, in the order of `indices`."""

    indices: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """Answer to renew, complete, expect, grant, done, lost, trouble and control."""

    status: VerdictStatus
    reason: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Why the status is not OK, unless the report was merely late."""


@dataclass(frozen=True, kw_only=True, slots=True)
class StatusRequest:
    """Asks for the run's progress."""


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
    kept: dict[str, int] = field(default_factory=dict, metadata=OMITTED_WHEN_DEFAULT)
    """Episodes that continue, or are durable, although a stage rejected them, by reason."""
    policies: int = field(default=0, metadata=OMITTED_WHEN_DEFAULT)
    """Policies that were offered to the run so far."""
    trouble: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """What an operator must mend before the run continues, such as a full disk; empty while it runs."""
    paused: bool = field(default=False, metadata=OMITTED_WHEN_DEFAULT)
    """True while no work is given out, by an operator's wish."""
    run: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Name of the run on the bus, by which a client of a router with several runs tells them apart."""
    priority: int = field(default=0, metadata=OMITTED_WHEN_DEFAULT)
    """Workers of several runs do those with a higher one first."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSpec:
    """Everything that fixes a run's samples, and where to find it."""

    run: str
    """Name of the run on the bus."""
    scene_path: str
    scene_hash: str
    """Hash of the scene's content, `readygo.common.scenes.Scene.content_hash`."""
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
    """Resolved sections of settings, see `RunConfig`."""
    metadata: dict[str, Any]
    """Versions, commit and licenses, recorded with the data; not part of the identity."""
    scenarios: str = ""
    """Text of the scenario file that the episodes play; empty if they are drawn."""
    stages: tuple[Stage, ...] = field(default=EXPERT_LINE, metadata=OMITTED_WHEN_DEFAULT)
    """The assembly line that every episode passes, in order; the last stage records."""
    policy: PolicyRef | None = field(default=None, metadata=OMITTED_WHEN_DEFAULT)
    """The policy that drives; None where the expert alone drives."""
    avatar_files: tuple[FileRef, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """The files at `avatars_path`; none where the avatars are the embedded ones."""
    teacher: TeacherRef | None = field(default=None, metadata=OMITTED_WHEN_DEFAULT)
    """The teacher in the expert's place; None where the expert labels."""

    def __post_init__(self) -> None:
        check_sha256("scene_hash", self.scene_hash)
        for name, avatar_hash in self.avatar_hashes.items():
            check_sha256(f"avatar_hashes of {name[:NAME_MAX]!r}", avatar_hash)
        check_stages(self.stages)


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSpecRequest:
    """Asks for the run's specification."""

    role: str = field(default="", metadata=OMITTED_WHEN_DEFAULT)
    """Role in which the asker will join the run; empty for a client that only looks."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ControlRequest:
    """An operator's command."""

    command: Command
