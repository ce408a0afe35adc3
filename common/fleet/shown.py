"""What workers show of episodes while they make them; see docs/live.md."""

import math
import resource
import time
from collections.abc import Sequence

import numpy as np

from readygo.common.bus import Bus
from readygo.common.images.names import SHOWN_KINDS, kind_of
from readygo.common.messages import ClaimReply, EpisodeHeader, RobotTrajectory, Sample, Scenario, Stage, topics
from readygo.common.messages.live import LivePlan, LivePreview, LiveState, LiveWork

PLAN_STRIDE = 4
"""Samples from pose to pose of a plan that is shown."""


def show_newest(bus: Bus, header: EpisodeHeader, samples: Sequence[Sample]) -> None:
    """Show the newest of an episode's samples, and the newest image."""
    newest = samples[-1]
    bus.tell(topics.STATE, lambda: state_of(header, newest))
    pictured = next((sample for sample in reversed(samples) if sample.image), None)
    if pictured is not None:
        bus.tell(
            topics.PREVIEW,
            lambda: LivePreview(
                episode=header.episode,
                time_ns=pictured.time_ns,
                format=header.image_format,
                image=pictured.image,
                outputs={name: image for name, image in pictured.outputs.items() if is_shown(name)},
            ),
        )


def is_shown(name: str) -> bool:
    """True for images that are shown besides the first camera's colours: other cameras' ones, and depths."""
    return kind_of(name) in SHOWN_KINDS


def state_of(header: EpisodeHeader, sample: Sample) -> LiveState:
    """Where everybody is at a sample."""
    return LiveState(
        episode=header.episode,
        time_ns=sample.time_ns,
        sample=sample.seq,
        sample_count=header.sample_count,
        driver=header.driver,
        goal_xy_m=header.goal_xy_m,
        robot_xyzyaw=sample.robot_xyzyaw,
        v_mps=sample.action_v_mps,
        w_radps=sample.action_w_radps,
        humans_xyzyaw=sample.humans_xyzyaw,
        human_visible=sample.human_visible,
        human_distance_m=sample.human_distance_m,
        time_to_collision_s=sample.time_to_collision_s,
        replanned=sample.replanned,
        horizontal_fov_rad=2 * math.atan(header.width_px / (2 * header.K_px[0])),
    )


def show_work(bus: Bus, stage: Stage, claim: ClaimReply, *, begins: bool, rejected: str = "", failed: str = "") -> None:
    """Show what this worker does, and what its process has taken so far."""
    episode = claim.episode
    assert episode is not None
    bus.tell(
        topics.WORK,
        lambda: LiveWork(
            stage=stage.name,
            episode=episode,
            attempt=claim.attempt,
            begins=begins,
            cpu_s=time.process_time(),
            memory_bytes=1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
            rejected=rejected,
            failed=failed,
        ),
    )


def show_plan(bus: Bus, scenario: Scenario, trajectory: RobotTrajectory) -> None:
    """Show what the expert planned for an episode."""
    bus.tell(topics.PLAN, lambda: plan_of(scenario, trajectory))


def plan_of(scenario: Scenario, trajectory: RobotTrajectory) -> LivePlan:
    """The expert's plan of an episode, at fewer points."""
    starts = np.arange(0, len(trajectory.xyyaw), PLAN_STRIDE)
    goal_x_m, goal_y_m = scenario.goal_xy_m.tolist()
    return LivePlan(
        episode=scenario.episode,
        outcome=trajectory.outcome,
        goal_xy_m=(goal_x_m, goal_y_m),
        robot_xyyaw=trajectory.xyyaw[starts].astype(np.float32),
        replanned=np.logical_or.reduceat(trajectory.replanned, starts),
        humans_xy_m=tuple(human.xy_m[::PLAN_STRIDE].astype(np.float32) for human in scenario.humans),
    )
