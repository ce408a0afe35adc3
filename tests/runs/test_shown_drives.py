import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from readygo.common.bus import InProcessBus
from readygo.common.messages import DriverKind, Outcome, topics
from readygo.common.perception import PeopleTracker, Perceived
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS
from readygo.common.robot import RobotConfig
from readygo.runs.shown_drives import EVERY_S, ShownDrives, drive_perception, drive_state
from tests.common.perception.test_live import EPISODE
from tests.common.perception.test_tracker import everywhere, seen
from tests.waiting import wait_for

FLOOR = SimpleNamespace(at=lambda x, y: 0.5)
POSE = (1.0, 2.0, math.pi / 2)
IMAGE = np.full((144, 256, 3), 90, np.uint8)


def simulation(step=4):
    """A robot that looks along y, and a human 3 m ahead of it who walks against it at 1 m/s."""
    robot = RobotConfig()
    return SimpleNamespace(
        scenario=SimpleNamespace(episode=EPISODE, goal_xy_m=np.array([1.0, 6.0])),
        config=SimpleNamespace(time_limit_s=50.0),
        robot=robot,
        clock=robot.clock,
        step=step,
        time_ns=robot.clock.time_ns(step),
        x_m=POSE[0],
        y_m=POSE[1],
        yaw_rad=POSE[2],
        v_mps=0.5,
        w_radps=0.1,
        outcome=None,
        contact_m=0.5,
        human_xy_m=np.array([[1.0, 5.0]]),
        human_xy_at=lambda step: np.array([[1.0, 5.05]]),
    )


def perceiving():
    tracker = PeopleTracker(None, None)
    people = seen((3.0, 0.0, -1.0, 0.0))
    tracker.fuse(POSE, people, everywhere)
    perceived = Perceived(
        people=people,
        rays_m=np.full(SHAPE[1], 2.0),
        rays_sd=np.full(SHAPE[1], 0.1),
        answers=np.zeros((CHANNELS, *SHAPE)),
    )
    return SimpleNamespace(pose=POSE, perceived=perceived, people=SimpleNamespace(tracker=tracker))


def test_state_has_robot_and_humans_on_the_floor() -> None:
    state = drive_state(simulation(), perceiving(), FLOOR, DriverKind.POLICY)
    assert state.driver is DriverKind.POLICY
    assert state.robot_xyzyaw == (1.0, 2.0, 0.5, math.pi / 2)
    assert state.humans_xyzyaw == (pytest.approx((1.0, 5.0, 0.5, -math.pi / 2)),)
    assert (state.sample, state.sample_count, state.human_visible) == (4, 1000, True)
    assert state.human_distance_m == pytest.approx(3.0)
    # They come together at 1.5 m/s until 0.5 m are left.
    assert state.time_to_collision_s == pytest.approx(2.5 / 1.5)
    assert state.horizontal_fov_rad == pytest.approx(math.radians(100.0))


def test_perception_is_in_the_world() -> None:
    told = drive_perception(simulation(), perceiving(), FLOOR)
    assert told.robot_xyzyaw == (1.0, 2.0, 0.5, math.pi / 2)
    assert told.detections[0].xy_m == pytest.approx((1.0, 5.0))
    assert told.tracks[0].xy_m == pytest.approx((1.0, 5.0))


def test_one_episode_is_shown_at_a_time_and_all_three_messages_are_of_one_look() -> None:
    run, heard = InProcessBus(), {}
    watch, worker = InProcessBus(run), InProcessBus(run)
    worker.announce("evaluator", "evaluator0")
    for live in (topics.STATE, topics.PERCEPTION, topics.PREVIEW):
        heard[live.kind] = []
        watch.subscribe(live.of("evaluator", "evaluator0"), heard[live.kind].append)
    now_s = [0.0]
    # The bus's own gate is of the wall clock.
    worker._teller._clock = lambda: now_s[0]
    shown = ShownDrives(worker, FLOOR, DriverKind.POLICY, clock=lambda: now_s[0])
    first, second = simulation(4), simulation(8)
    for moment in range(40):
        now_s[0] = 0.05 * moment
        for each in (first, second):
            shown(each, perceiving(), IMAGE)
    first.outcome = Outcome.SUCCESS
    now_s[0] = 9.0
    shown(second, perceiving(), IMAGE)
    # A subscriber's own thread hears; messages of one stream arrive in order.
    wait_for(lambda: all(messages and messages[-1].time_ns == second.time_ns for messages in heard.values()))
    times = {kind: [message.time_ns for message in messages] for kind, messages in heard.items()}
    assert times["state"] == times["perception"] == times["preview"]
    assert set(times["state"][:-1]) == {first.time_ns}
    assert len(times["state"]) == pytest.approx(1 + 2.0 / EVERY_S, abs=1)
    image = cv2.imdecode(np.frombuffer(heard["preview"][0].image, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == IMAGE.shape


def test_nothing_is_made_where_nobody_listens() -> None:
    bus = InProcessBus()
    bus.announce("evaluator", "evaluator0")
    ShownDrives(bus, FLOOR, DriverKind.EXPERT)(simulation(), None, IMAGE)
