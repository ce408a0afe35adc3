"""Every message that crosses a process boundary, one file per topic, and their codec."""

from common.messages.codec import decode, encode
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
    "EpisodeHeader",
    "EpisodeKey",
    "EpisodeMotions",
    "HumanMotion",
    "HumanPlanReply",
    "HumanPlanRequest",
    "HumanTrajectory",
    "Motion",
    "Outcome",
    "People",
    "RenderReply",
    "RenderRequest",
    "RenderView",
    "RobotPlanReply",
    "RobotPlanRequest",
    "RobotTrajectory",
    "Sample",
    "Scenario",
    "Split",
    "decode",
    "encode",
]
