"""Every message that crosses a process boundary, one file per topic, and their codec."""

from common.messages.codec import decode, encode
from common.messages.coordination import (
    Blob,
    BlobReply,
    BlobRequest,
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    DoneRequest,
    GrantRequest,
    LostRequest,
    PendingReply,
    PendingRequest,
    RenewRequest,
    Stage,
    StatusReply,
    StatusRequest,
    Verdict,
)
from common.messages.episode import EpisodeKey, HumanTrajectory, Scenario, Split
from common.messages.motion import EpisodeMotions, HumanMotion, Motion
from common.messages.plan import Outcome, RobotTrajectory
from common.messages.render import People, RenderReply, RenderRequest, RenderView
from common.messages.samples import AppendReply, AppendRequest, EpisodeHeader, Sample
from common.messages.stages import (
    AnimateReply,
    AnimateRequest,
    HumanPlanReply,
    HumanPlanRequest,
    RobotPlanReply,
    RobotPlanRequest,
)

__all__ = [
    "AnimateReply",
    "AnimateRequest",
    "AppendReply",
    "AppendRequest",
    "Blob",
    "BlobReply",
    "BlobRequest",
    "ClaimReply",
    "ClaimRequest",
    "CompleteRequest",
    "DoneRequest",
    "EpisodeHeader",
    "EpisodeKey",
    "EpisodeMotions",
    "GrantRequest",
    "HumanMotion",
    "HumanPlanReply",
    "HumanPlanRequest",
    "HumanTrajectory",
    "LostRequest",
    "Motion",
    "Outcome",
    "PendingReply",
    "PendingRequest",
    "People",
    "RenderReply",
    "RenderRequest",
    "RenderView",
    "RenewRequest",
    "RobotPlanReply",
    "RobotPlanRequest",
    "RobotTrajectory",
    "Sample",
    "Scenario",
    "Split",
    "Stage",
    "StatusReply",
    "StatusRequest",
    "Verdict",
    "decode",
    "encode",
]
