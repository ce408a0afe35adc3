import dataclasses
import math
import queue
from typing import Any

import numpy as np

from readygo.common.bus import InProcessBus
from readygo.common.fleet.shown import plan_of, show_newest, show_work
from readygo.common.messages import ClaimReply, ClaimStatus, Outcome, RobotTrajectory, Scenario, decode, encode, topics
from readygo.common.messages.episode import HumanTrajectory
from readygo.common.messages.live import LivePlan, LivePreview, LiveWork
from readygo.common.messages.stages import RENDER
from tests.common.dataset.episodes import make_episode, with_left_camera


def heard(live: Any) -> tuple[InProcessBus, "queue.SimpleQueue[Any]"]:
    """A worker's bus, and what somebody else hears of it."""
    bus: InProcessBus = InProcessBus()
    bus.announce("renderer", "r0")
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    InProcessBus(bus).subscribe(live.of(), messages.put)
    return bus, messages


def test_newest_sample_and_newest_image_are_shown() -> None:
    header, samples = make_episode(0, 12)
    bus, states = heard(topics.STATE)
    show_newest(bus, header, samples)
    state = states.get(timeout=5)
    assert (state.sample, state.sample_count, state.robot_xyzyaw) == (11, 12, samples[11].robot_xyzyaw)
    assert 0 < state.horizontal_fov_rad < math.pi
    bus, previews = heard(topics.PREVIEW)
    show_newest(bus, header, samples)
    assert previews.get(timeout=5).image == samples[11].image


def test_preview_has_the_colours_and_depths_of_all_cameras() -> None:
    header, samples = with_left_camera(*make_episode(0, 1))
    bus, previews = heard(topics.PREVIEW)
    (sample,) = samples
    outputs = {**sample.outputs, "mask": b"png", "goal_image": b"jpeg"}
    show_newest(bus, header, [dataclasses.replace(sample, outputs=outputs)])
    preview = previews.get(timeout=5)
    assert preview.outputs == sample.outputs
    assert set(preview.outputs) == {"left.rgb", "left.depth"}
    assert decode(LivePreview, encode(preview)) == preview


def test_work_names_stage_and_reason() -> None:
    bus, messages = heard(topics.WORK)
    header, _ = make_episode(3, 1)
    claim = ClaimReply(status=ClaimStatus.LEASE, episode=header.episode, attempt=2)
    show_work(bus, RENDER, claim, begins=False, rejected="fog")
    said = messages.get(timeout=5)
    assert (said.stage, said.episode, said.attempt, said.rejected) == ("render", header.episode, 2, "fog")
    assert said.cpu_s > 0
    assert said.memory_bytes > 1e6
    assert decode(LiveWork, encode(said)) == said


def test_plan_keeps_every_replan_and_fewer_poses() -> None:
    count = 10
    replanned = np.zeros(count, np.bool_)
    replanned[6] = True
    columns = {name: np.zeros(count) for name in ("human_distance_m", "time_to_collision_s", "expert_cost")}
    trajectory = RobotTrajectory(
        outcome=Outcome.TIMEOUT,
        xyyaw=np.arange(30.0).reshape(10, 3),
        actions=np.zeros((count, 2)),
        replanned=replanned,
        human_visible=replanned,
        replan_times_s=np.zeros(1),
        **columns,
    )
    header, _ = make_episode(0, 1)
    human = HumanTrajectory(avatar="ann", encounter="crossing", speed_mps=1.0, xy_m=np.ones((9, 2)))
    scenario = Scenario(
        episode=header.episode, start_xyyaw=np.zeros(3), goal_xy_m=np.array([1.0, 2.0]), humans=(human,)
    )
    plan = decode(LivePlan, encode(plan_of(scenario, trajectory)))
    assert plan.robot_xyyaw[:, 0].tolist() == [0.0, 12.0, 24.0]
    assert plan.replanned.tolist() == [False, True, False]
    assert plan.humans_xy_m[0].shape == (3, 2)
    assert (plan.outcome, plan.goal_xy_m) == (Outcome.TIMEOUT, (1.0, 2.0))
