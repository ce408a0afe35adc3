"""The stages of the assembly line: from a lease and the earlier results to this stage's result."""

import time
from collections.abc import Iterator
from itertools import islice

from readygo.apps.run.world import World
from readygo.common.bus import Bus, StageResult
from readygo.common.bus.leases import Work
from readygo.common.errors import BusError, RunError
from readygo.common.messages import (
    AnimateReply,
    AnimateRequest,
    AppendReply,
    AppendRequest,
    ClaimReply,
    EpisodeHeader,
    HumanPlanReply,
    HumanPlanRequest,
    RobotPlanReply,
    RobotPlanRequest,
    Sample,
    Stage,
    decode,
    encode,
)
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import HumanPlanner, RobotPlanner, handle_human_plan, handle_robot_plan
from readygo.services.renderer import Renderer, episode_header, episode_samples

BATCH = 8
"""Samples per append: the recorder's acknowledgement costs less than the images from here on."""
RECORDER_ABSENT_S = 60.0


def stage_work(stage: Stage, world: World, bus: Bus) -> Work:
    """The work of a stage, its scene and avatars loaded."""
    if stage is Stage.HUMAN_PLAN:
        return _plan_humans(world.human_planner(), static=world.spec.static)
    if stage is Stage.ANIMATE:
        return _animate(world.animator())
    if stage is Stage.ROBOT_PLAN:
        return _plan_robot(world.robot_planner)
    return _render(world.renderer(), bus)


def _plan_humans(planner: HumanPlanner, *, static: bool) -> Work:
    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult:
        assert claim.episode is not None
        reply = handle_human_plan(planner, HumanPlanRequest(episode=claim.episode, static=static))
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _animate(animator: Animator) -> Work:
    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult:
        scenario = decode(HumanPlanReply, inputs[0]).scenario
        assert scenario is not None
        reply = handle_animate(animator, AnimateRequest(scenario=scenario))
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _plan_robot(planner: RobotPlanner) -> Work:
    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult:
        scenario = decode(HumanPlanReply, inputs[0]).scenario
        motions = decode(AnimateReply, inputs[1]).motions
        assert scenario is not None
        assert motions is not None
        reply = handle_robot_plan(planner, RobotPlanRequest(scenario=scenario, motions=motions))
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _render(renderer: Renderer, bus: Bus) -> Work:
    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> None:
        scenario = decode(HumanPlanReply, inputs[0]).scenario
        motions = decode(AnimateReply, inputs[1]).motions
        trajectory = decode(RobotPlanReply, inputs[2]).trajectory
        assert scenario is not None
        assert motions is not None
        assert trajectory is not None
        header = episode_header(renderer, scenario, trajectory)
        append_episode(bus, claim, header, episode_samples(renderer, scenario, motions, trajectory))

    return work


def append_episode(bus: Bus, claim: ClaimReply, header: EpisodeHeader, samples: Iterator[Sample]) -> None:
    """Send an episode to its recorder in acknowledged batches, until it is durable or the attempt is stale.

    Raises:
        RunError: If the recorder refuses the samples or stays away.
    """
    sent: list[Sample] = []
    acknowledged = 0
    while acknowledged < header.sample_count:
        while len(sent) < min(acknowledged + BATCH, header.sample_count):
            sent.extend(islice(samples, acknowledged + BATCH - len(sent)))
        batch = tuple(sent[acknowledged : acknowledged + BATCH])
        last = acknowledged + len(batch) == header.sample_count
        request = AppendRequest(attempt=claim.attempt, header=header, first_seq=acknowledged, samples=batch, last=last)
        reply = _append(bus, claim.recorder, request)
        if reply.status == "gap":
            acknowledged = reply.expected_seq
        elif reply.status == "ok":
            acknowledged += len(batch)
        elif reply.status in ("committed", "dup", "stale"):
            return
        else:
            raise RunError(f"Recorder {claim.recorder} answered {reply.status!r}: {reply.detail}")


def _append(bus: Bus, recorder: str, request: AppendRequest) -> AppendReply:
    deadline_s = time.monotonic() + RECORDER_ABSENT_S
    while True:
        try:
            reply = bus.request(f"rec/{recorder}/append", request, AppendReply, timeout_s=20.0)
        except BusError as error:
            reply = AppendReply(status="retry", detail=str(error))
        if reply.status != "retry":
            return reply
        if time.monotonic() > deadline_s:
            raise RunError(f"Recorder {recorder} did not take the samples: {reply.detail}")
        time.sleep(0.2)
