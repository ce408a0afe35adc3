"""A simulated robot and a pilot on a network of their own, in real time."""

import dataclasses
import threading
import time
from contextlib import closing

import numpy as np
import pytest

from readygo.apps.drive.calibration import Rectifier, camera_from_info, info_of
from readygo.apps.drive.messages import GoalMessage, OdometryMessage
from readygo.apps.drive.named_topics import image_topics
from readygo.apps.drive.pilot import DriveConfig, Pilot, TrialEnding
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.robot import Topics, connect_robot
from readygo.apps.drive.ros_codec import RosCodec
from readygo.apps.drive.simulated import Manners, SimulatedRobot, odometry_of
from readygo.apps.drive.simulated import to_message_order as sent_as
from readygo.apps.drive.trial import Measures, _step, run_trial
from readygo.apps.drive.wires import RosWire, TopicWire
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.camera import CameraConfig
from readygo.common.messages import Outcome, Split
from readygo.common.robot import Clock, RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world, make_evaluator
from readygo.services.evaluator import Task
from tests.apps.drive.conftest import CAMERA, FakePolicy, open_ground
from tests.common.policy.artifacts import graph_seeing

TOPICS = Topics(
    image="/camera/image_raw",
    odometry="/odom",
    command="/cmd_vel",
    camera_info="/camera/camera_info",
    goal="/goal_pose",
    outcome="/outcome",
)
INFO = info_of(CAMERA)


class StraightPolicy(FakePolicy):
    """Drives straight ahead."""

    def __init__(self):
        super().__init__((1.0, 0.0))
        self.sights = []

    def see(self, memories, images, times_ns):
        self.sights.append(images[0])
        super().see(memories, images, times_ns)


@pytest.mark.parametrize(
    ("kind", "depth"), [("ros2", "/camera/depth"), ("bridge", "/camera/depth/compressedDepth"), ("plain", "")]
)
def test_policy_drives_a_robot_to_its_goal_over_every_wire(kind, depth):
    pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
    make = {
        "ros2": lambda node: RosWire(7, node),
        "bridge": lambda node: TopicWire(RosCodec(), stamped=True),
        "plain": lambda node: TopicWire(PlainCodec(), "robot1"),
    }[kind]
    endpoint, outcomes = free_endpoint(), []
    run = open_ground()
    with closing(Router(endpoint)), closing(ForeignSession(endpoint)) as session:
        manners = Manners(latency_s=0.02, jitter_s=0.005, drop_share=0.1, compressed=kind == "bridge")
        topics = dataclasses.replace(TOPICS, beside={"depth": depth} if depth else {})
        if kind == "bridge":
            topics = dataclasses.replace(topics, image="/camera/image_raw/compressed")
        images = {"rgb": np.zeros((8, 10, 3), np.uint8), "depth": np.full((8, 10), 5.0, np.float32)}
        robot = SimulatedRobot(
            session, make("robot"), topics, {"": INFO}, lambda _: images, manners, np.random.default_rng(0)
        )
        thread = threading.Thread(target=lambda: outcomes.append(robot.drive(run)), daemon=True)
        thread.start()
        link = connect_robot(endpoint, make("drive"), topics, dry=False)
        until_s = time.monotonic() + 10.0
        while "" not in link.cameras or link.goal is None:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        rectify = {"": Rectifier(camera_from_info(CAMERA, link.cameras[""]), CAMERA)}
        config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2, goal_in_start_frame=False, time_limit_s=15.0)
        policy = StraightPolicy()
        if depth:
            policy.spec = dataclasses.replace(policy.spec, graph=graph_seeing(("rgb", "depth")))
        pilot = Pilot(policy, rectify, config, link.goal)
        run_trial(link, pilot, rate_hz=20, say=lambda words: None)
        link.close()
        thread.join(10.0)
    assert outcomes == [Outcome.SUCCESS]
    assert pilot.ending is TrialEnding.GOAL
    assert run.v_mps <= 1.0
    assert policy.sights[-1][0, 0].tolist() == [0, 0, 0, *([128] if depth else [])]
    assert pilot.driven_m == pytest.approx(1.0, abs=0.3)


SEEN = ("rgb", "depth", "left.rgb", "left.depth", "right.rgb", "right.depth")
THREE_CAMERAS = RobotConfig(
    camera=CameraConfig(height_px=24, width_px=40),
    cameras={
        "left": CameraConfig(height_px=24, width_px=40, mount_y_m=0.15, mount_yaw_deg=75.0),
        "right": CameraConfig(height_px=24, width_px=40, mount_y_m=-0.15, mount_yaw_deg=-75.0),
    },
)


@pytest.fixture(scope="module")
def evaluator():
    config = dataclasses.replace(RunConfig(), robot=THREE_CAMERAS)
    world = evaluation_world("embedded", config, avatars=None, seed=0)
    return make_evaluator(world, renderer=world.renderer(), methods={})


class StillPolicy(StraightPolicy):
    """Sees with three cameras, and stands."""

    def __init__(self):
        super().__init__()
        self.answer = (0.0, 0.0)
        self.spec = dataclasses.replace(self.spec, robot=THREE_CAMERAS, graph=graph_seeing(SEEN))


@pytest.mark.parametrize(("compressed", "levels"), [(False, 0.0), (True, 4.0)])
def test_policy_sees_over_the_network_what_it_sees_in_an_evaluation(evaluator, compressed, levels):
    pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
    (episode,), _ = evaluator.source().draw(seed=0, split=Split.TEST, count=1, tasks=(Task.DYNAMIC,))
    run, eyes = evaluator.simulation(episode), evaluator.eyes(SEEN)
    expected = eyes.look([run])[0].astype(int)
    endpoint = free_endpoint()
    named = image_topics(
        (), ("/camera/depth", "left=/left/depth", "right=/right/depth"), THREE_CAMERAS, every_camera=True
    )
    beside = {name: topic for name, topic in named.items() if name != "rgb"}
    infos = {"left": "/left/camera_info", "right": "/right/camera_info"}
    topics = dataclasses.replace(TOPICS, beside=beside, infos=infos)
    cameras = {"": THREE_CAMERAS.camera, **THREE_CAMERAS.cameras}
    with closing(Router(endpoint)), closing(ForeignSession(endpoint)) as session:
        robot = SimulatedRobot(
            session,
            RosWire(7, "robot"),
            topics,
            {name: info_of(camera) for name, camera in cameras.items()},
            lambda one: {name: images[0] for name, images in eyes.measure([one]).items()},
            Manners(latency_s=0.01, jitter_s=0.005, drop_share=0.1, compressed=compressed, camera_hz=10.0),
            np.random.default_rng(0),
        )
        over = threading.Event()
        thread = threading.Thread(target=lambda: robot._stand(run, over.is_set), daemon=True)
        thread.start()
        link = connect_robot(endpoint, RosWire(7, "drive"), topics, dry=False)
        until_s = time.monotonic() + 60.0
        while set(link.cameras) != set(cameras):
            assert time.monotonic() < until_s
            time.sleep(0.01)
        rectify = {
            name: Rectifier(camera_from_info(camera, link.cameras[name]), camera) for name, camera in cameras.items()
        }
        policy = StillPolicy()
        config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2, time_limit_s=1.0)
        pilot = Pilot(policy, rectify, config, GoalMessage(x_m=5.0, y_m=0.0))
        while not policy.sights:
            assert time.monotonic() < until_s, pilot.waiting_for
            _step(link, pilot, Measures(), time.monotonic() + 0.05)
        link.close()
        over.set()
        thread.join(10.0)
    seen = policy.sights[0].astype(int)
    assert seen.shape == expected.shape == (24, 40, 12)
    colours, depths = [0, 1, 2, 4, 5, 6, 8, 9, 10], [3, 7, 11]
    assert np.abs(seen - expected)[..., colours].mean() <= levels
    assert np.abs(seen - expected)[..., depths].max() <= 1, "millimetres are what a message has"
    assert len({expected[..., channel].tobytes() for channel in range(12)}) == 12, "every camera sees something else"


@pytest.mark.parametrize("wrong", [{"latency_s": -1.0}, {"drop_share": 1.0}])
def test_manners_that_no_robot_has_are_refused(wrong):
    with pytest.raises(ValueError, match="must"):
        Manners(**wrong)


def test_images_are_as_late_and_as_often_lost_as_manners_say():
    manners, rng = Manners(latency_s=0.05, jitter_s=0.02, drop_share=0.3), np.random.default_rng(1)
    sent = [manners.draw_latencies(("rgb", "depth"), rng) for _ in range(4000)]
    late_s = np.array([late for one in sent for late in one.values()])
    assert len(late_s) / 8000 == pytest.approx(0.7, abs=0.02)
    assert {name for one in sent for name in one} == {"rgb", "depth"}
    assert late_s.min() >= 0.0
    assert (late_s.mean(), late_s.std()) == pytest.approx((0.05, 0.02), abs=0.002)
    assert Manners(latency_s=0.0, jitter_s=0.0, drop_share=0.0).draw_latencies(("rgb",), rng) == {"rgb": 0.0}
    with pytest.raises(ValueError, match="must"):
        Manners(jitter_s=-0.1)
    with pytest.raises(ValueError, match="must"):
        Manners(drop_share=-0.01)
    assert Manners(camera_hz=2.5).image_every(Clock(image_every=2)) == 8


def test_odometry_is_of_the_moment():
    run = open_ground()
    run.advance(0.7, -0.4)
    run.advance(0.9, 0.3)
    wanted = OdometryMessage(
        stamp_ns=5, x_m=run.x_m, y_m=run.y_m, yaw_rad=run.yaw_rad, v_mps=run.v_mps, w_radps=run.w_radps
    )
    assert odometry_of(run, 5) == wanted
    assert len({wanted.x_m, wanted.y_m, wanted.yaw_rad, wanted.v_mps, wanted.w_radps}) == 5
    image = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    np.testing.assert_array_equal(sent_as(image), image[:, :, [2, 1, 0]])
    assert sent_as(image[..., 0]) is not None
