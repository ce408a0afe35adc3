"""Every topic of the bus, with the messages that it carries; all lie below the run's own prefix.

A `Topic` is answered by one server, a `Stream` is heard by any number of subscribers.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

from readygo.common.messages.coordination import (
    BlobReply,
    BlobRequest,
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    ControlRequest,
    DoneRequest,
    ExpectRequest,
    GrantRequest,
    LostRequest,
    PendingReply,
    PendingRequest,
    RenewRequest,
    RunSpec,
    RunSpecRequest,
    StatusReply,
    StatusRequest,
    TroubleRequest,
    Verdict,
    Wake,
)
from readygo.common.messages.evaluation import (
    DrivesReply,
    DrivesRequest,
    EvaluationPlan,
    EvaluationPlanRequest,
    KeepRequest,
)
from readygo.common.messages.fleet import FleetReply, FleetRequest
from readygo.common.messages.learning import CommittedEpisode, OfferReply, OfferRequest
from readygo.common.messages.live import (
    LiveCommit,
    LiveEvaluation,
    LiveHealth,
    LiveLoss,
    LivePerception,
    LivePlan,
    LivePreview,
    LiveState,
    LiveWork,
)
from readygo.common.messages.reconstruction import (
    ReconstructionClaim,
    ReconstructionJob,
    ReconstructionProgress,
    ReconstructionReport,
)
from readygo.common.messages.render import RenderReply, RenderRequest
from readygo.common.messages.samples import AppendReply, AppendRequest
from readygo.common.messages.stages import (
    AnimateReply,
    AnimateRequest,
    HumanPlanReply,
    HumanPlanRequest,
    RobotPlanReply,
    RobotPlanRequest,
)

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")


@dataclass(frozen=True, slots=True)
class Topic(Generic[Request, Reply]):
    """Name of requests of one kind, which one server answers."""

    name: str
    request_type: type[Request]
    reply_type: type[Reply]


@dataclass(frozen=True, slots=True)
class Stream(Generic[Message]):
    """Name under which messages of one kind are published. Lossy: slow or late subscribers miss messages."""

    name: str
    message_type: type[Message]


@dataclass(frozen=True, slots=True)
class Live(Generic[Message]):
    """What every participant of one kind may publish, each on a separate stream."""

    kind: str
    message_type: type[Message]
    every_s: float = 0.0
    """Time between two messages of one participant, at least [s]."""

    def of(self, role: str = "*", name: str = "*") -> Stream[Message]:
        """The stream of a participant; "*" stands for all, to subscribe."""
        return Stream(f"live/{role}/{name}/{self.kind}", self.message_type)


SPEC = Topic("coord/spec", RunSpecRequest, RunSpec)
EXPECT = Topic("coord/rec/expect", ExpectRequest, Verdict)
GRANT = Topic("coord/rec/grant", GrantRequest, Verdict)
DONE = Topic("coord/rec/done", DoneRequest, Verdict)
LOST = Topic("coord/rec/lost", LostRequest, Verdict)
TROUBLE = Topic("coord/rec/trouble", TroubleRequest, Verdict)
PENDING = Topic("coord/rec/pending", PendingRequest, PendingReply)
BLOB = Topic("blob", BlobRequest, BlobReply)
CONTROL = Topic("ctl", ControlRequest, Verdict)
STATUS = Topic("ctl/status", StatusRequest, StatusReply)
FLEET = Topic("ctl/fleet", FleetRequest, FleetReply)
OFFER = Topic("coord/policy", OfferRequest, OfferReply)

HUMAN_PLAN = Topic("human-plan", HumanPlanRequest, HumanPlanReply)
ANIMATE = Topic("animate", AnimateRequest, AnimateReply)
ROBOT_PLAN = Topic("robot-plan", RobotPlanRequest, RobotPlanReply)

EVALUATION_PLAN = Topic("evaluate/plan", EvaluationPlanRequest, EvaluationPlan)
EVALUATION_DRIVES = Topic("evaluate/drives", DrivesRequest, DrivesReply)
EVALUATION_KEEP = Topic("evaluate/keep", KeepRequest, Verdict)

RECONSTRUCTION_CLAIM = Topic("reconstruct/claim", ReconstructionClaim, ReconstructionJob)
RECONSTRUCTION_REPORT = Topic("reconstruct/report", ReconstructionReport, Verdict)

PROGRESS = Stream("live/progress", StatusReply)
"""The coordinator's status, a few times a second."""
WAKE = Stream("live/wake", Wake)
"""Sent when there may be work for a worker that was told to wait."""
PREVIEW = Live("preview", LivePreview, every_s=0.2)
STATE = Live("state", LiveState, every_s=0.2)
PERCEPTION = Live("perception", LivePerception, every_s=0.2)
PLAN = Live("plan", LivePlan)
WORK = Live("work", LiveWork)
COMMIT = Live("commit", LiveCommit)
HEALTH = Live("health", LiveHealth)
LOSS = Live("loss", LiveLoss)
EVALUATION = Live("evaluation", LiveEvaluation)
COMMITTED = Stream("train/episodes", CommittedEpisode)
"""Every episode, as soon as it is durable."""

RECONSTRUCTION = Stream("live/reconstruct", ReconstructionProgress)
"""How far the reconstruction of a scene is: when a stage begins, and every second while Gaussians are trained."""


def claim(stage: str) -> Topic[ClaimRequest, ClaimReply]:
    """Topic on which the workers of a stage ask for work."""
    return Topic(f"coord/{stage}/claim", ClaimRequest, ClaimReply)


def renew(stage: str) -> Topic[RenewRequest, Verdict]:
    """Topic on which the workers of a stage prolong their leases."""
    return Topic(f"coord/{stage}/renew", RenewRequest, Verdict)


def complete(stage: str) -> Topic[CompleteRequest, Verdict]:
    """Topic on which the workers of a stage hand over their results."""
    return Topic(f"coord/{stage}/complete", CompleteRequest, Verdict)


def append(recorder: str) -> Topic[AppendRequest, AppendReply]:
    """Topic on which a recorder takes samples."""
    return Topic(f"rec/{recorder}/append", AppendRequest, AppendReply)


def render(renderer: str) -> Topic[RenderRequest, RenderReply]:
    """Topic on which a renderer draws views."""
    return Topic(f"render/{renderer}", RenderRequest, RenderReply)


def presence(role: str, name: str) -> str:
    """Key of a worker's liveliness tokens; "*" stands for any role or name.

    `{session}` below it says that the worker is there, `claim/{session}` that it has or wants the name, and
    `turn/{number}` which of those who had it one after the other it is.
    """
    return f"alive/{role}/{name}"


def matches(pattern: str, name: str) -> bool:
    """True if a stream's name fits a pattern in which "*" stands for one part between slashes."""
    parts, names = pattern.split("/"), name.split("/")
    return len(parts) == len(names) and all(part in ("*", named) for part, named in zip(parts, names, strict=True))
