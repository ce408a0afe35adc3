"""`readygo drive` against a robot on a network of its own, and what it says to those who ask for nonsense."""

import dataclasses
import io
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from readygo.apps.commands import drive as command
from readygo.apps.commands.drive import (
    DriveLimitOptions,
    DriveOptions,
    DrivePeopleOptions,
    DriveTopicOptions,
    drive,
)
from readygo.apps.drive.calibration import info_of
from readygo.apps.drive.messages import GoalMessage, VelocityMessage
from readygo.apps.drive.ros_codec import IMAGE_TYPE, TWIST_TYPE, RosCodec
from readygo.apps.drive.trial_log import RECORD
from readygo.apps.drive.trials import read_trials
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.dataset.ros_log import read_record
from readygo.common.errors import BusError, ConfigError, PolicyError, RunError
from readygo.common.policy import PolicySpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.state_policy.actor import StateActor
from readygo.runs.config import RunConfig
from readygo.runs.policy import policy_sha256
from readygo.runs.teacher import teacher_ref
from readygo.services.evaluator import Category
from tests.apps.drive.conftest import CAMERA, Ride, odometry, picture
from tests.common.policy.artifacts import write_policy
from tests.common.state_policy.state_policies import write_state_policy
from tests.services.planner.worlds import make_robot_planner

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")


@pytest.fixture
def policy(tmp_path):
    return write_policy(tmp_path / "policy")


@pytest.fixture
def standing_robot():
    """A robot behind a bridge that sends all that is needed and stays where it is; gives endpoint and commands."""
    endpoint, codec, told, over = free_endpoint(), RosCodec(), [], threading.Event()
    with closing(Router(endpoint)), closing(ForeignSession(endpoint)) as session:
        session.hear("cmd_vel", lambda key, payload, _: told.append(codec.read(TWIST_TYPE, payload)))
        senders = {key: session.publisher(key) for key in ("camera/image_raw", "camera/camera_info", "odom")}

        def send():
            while not over.wait(0.05):
                now_ns = time.time_ns()
                senders["odom"].put(codec.write(ODOMETRY_TYPE, odometry(now_ns), now_ns))
                senders["camera/camera_info"].put(codec.write(INFO_TYPE, info_of(CAMERA), now_ns))
                senders["camera/image_raw"].put(codec.write(IMAGE_TYPE, np.zeros((8, 10, 3), np.uint8), now_ns))

        thread = threading.Thread(target=send)
        thread.start()
        yield endpoint, told
        over.set()
        thread.join()


def test_trial_is_driven_logged_and_told(policy, standing_robot, tmp_path, capsys):
    endpoint, told = standing_robot
    path = tmp_path / "trial.mcap"
    drive(
        DriveOptions(
            policy=policy,
            goal=(5.0, 0.0),
            wire="bridge",
            connect=endpoint,
            log=path,
            task="dynamic",
            limits=DriveLimitOptions(time_limit=0.6),
        )
    )
    out = capsys.readouterr().out
    assert "out of time after 0." in out
    assert "Hz possible), commands" in out
    assert told[-1] == VelocityMessage()
    record = read_record(path, RECORD)
    assert (record["ending"], record["task"], record["policy"]) == ("late", "dynamic", "policy")
    assert record["measures"]["command_hz"] >= 15


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_whoever_ends_it_the_robot_stands(policy, standing_robot, tmp_path, number):
    endpoint, told = standing_robot
    words = [sys.executable, "-m", "readygo", "drive", str(policy), "--goal", "5", "0", "--wire", "bridge"]
    log = tmp_path / "trial.mcap"
    process = subprocess.Popen(
        [*words, "--connect", endpoint, "--log", str(log)], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    until_s = time.monotonic() + 60.0
    while len(told) < 20 and time.monotonic() < until_s:
        time.sleep(0.02)
    os.kill(process.pid, number)
    _, said = process.communicate(timeout=30.0)
    assert said == f"readygo: stopped; the robot stands; the trial is in {log}.\n"
    assert process.returncode == 128 + (signal.SIGTERM if number == signal.SIGTERM else signal.SIGINT)
    assert told[-1] == VelocityMessage()
    assert read_record(log, RECORD)["ending"] == "stopped"


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, ConfigError, "either --goal X Y or --goal-topic"),
        ({"goal": (1.0, 0.0), "goal_topic": "/goal_pose"}, ConfigError, "either --goal X Y or --goal-topic"),
        (
            {"goal_topic": "/goal_pose", "limits": DriveLimitOptions(goal_frame="start")},
            ConfigError,
            "--goal-frame is for --goal",
        ),
        (
            {"goal": (1.0, 0.0), "limits": DriveLimitOptions(v_max=3.0)},
            ConfigError,
            "at most 1, what the policy learned, got 3",
        ),
        ({"goal": (1.0, 0.0), "limits": DriveLimitOptions(rate_hz=5.0)}, ConfigError, "--rate-hz must be at least 20"),
        (
            {"goal": (1.0, 0.0), "beside": DrivePeopleOptions(scene="embedded")},
            ConfigError,
            "--scene and --start are for --driver perceive-and-plan and perceive-and-act",
        ),
        (
            {"goal": (1.0, 0.0), "beside": DrivePeopleOptions(driver="perceive-and-plan")},
            ConfigError,
            "leave POLICY and --robot out",
        ),
        (
            {"policy": None, "goal": (1.0, 0.0), "beside": DrivePeopleOptions(driver="perceive-and-plan")},
            ConfigError,
            "needs --perception FOLDER and --scene SCENE",
        ),
        (
            {"goal": (1.0, 0.0), "robot": Path("r.toml"), "beside": DrivePeopleOptions(driver="perceive-and-act")},
            ConfigError,
            "drives the robot of its network: leave --robot out",
        ),
        (
            {"goal": (1.0, 0.0), "beside": DrivePeopleOptions(driver="perceive-and-act")},
            ConfigError,
            "--driver perceive-and-act needs --perception FOLDER and --scene SCENE",
        ),
        ({"policy": None, "goal": (1.0, 0.0)}, ConfigError, "Name the policy"),
        (
            {"goal": (1.0, 0.0), "beside": DrivePeopleOptions(perception=Path("nowhere"))},
            PolicyError,
            "nowhere holds no perception.toml",
        ),
        ({"goal": (1.0, 0.0), "connect": "tcp/127.0.0.1:1"}, BusError, "No Zenoh router answers at tcp/127.0.0.1:1"),
    ],
)
def test_what_makes_no_trial_is_said(policy, options, error, words):
    with pytest.raises(error, match=words):
        drive(DriveOptions(**{"policy": policy, **options}))


def test_state_policy_drives_the_robot_that_perception_knows(tmp_path):
    planner, settings = make_robot_planner(mode="spacetime"), RunConfig()
    with pytest.raises(ConfigError, match="needs a policy: readygo drive FOLDER, from `readygo rl`"):
        command._acting(None, settings, planner)
    with pytest.raises(PolicyError, match="holds no usable state policy"):
        command._acting(tmp_path, settings, planner)
    faster = write_state_policy(tmp_path / "faster", robot=RobotConfig(v_max_mps=1.5))
    with pytest.raises(PolicyError, match=r"another robot than perception \(v_max_mps is 1\.5, here 1\.0\)"):
        command._acting(faster, settings, planner)
    decider = command._acting(write_state_policy(tmp_path / "fits"), settings, planner)((-1.5, 5.0, 1.57), (-1.5, 9.0))
    assert isinstance(decider, StateActor)


def test_trial_names_the_policy_that_decided(tmp_path, policy):
    rl, beside = write_state_policy(tmp_path / "rl"), DrivePeopleOptions(driver="perceive-and-act")
    assert command._hash_of(DriveOptions(policy=rl, beside=beside)) == teacher_ref(rl).sha256
    assert command._hash_of(DriveOptions(policy=policy)) == policy_sha256(policy)
    assert command._hash_of(DriveOptions()) == ""


def test_policy_for_several_robots_wants_to_know_which_one_it_drives(policy, tmp_path):
    text = (policy / "policy.toml").read_text()
    (policy / "policy.toml").write_text(text.replace("v_max_mps = []", "v_max_mps = [0.5, 1.2]"))
    with pytest.raises(ConfigError, match="knows several robots: say which one it drives with --robot"):
        drive(DriveOptions(policy=policy, goal=(1.0, 0.0)))
    robot = tmp_path / "robot.toml"
    robot.write_text("v_max_mps = 1.5\n")
    with pytest.raises(PolicyError, match=r"other ranges: v_max_mps 1\.5 \(the policy's: 0\.5 to 1\.2\)"):
        drive(DriveOptions(policy=policy, goal=(1.0, 0.0), robot=robot))
    robot.write_text("v_max_mps = 0.8\n")
    with pytest.raises(ConfigError, match=r"at most 0\.8, what the policy learned, got 1"):
        drive(DriveOptions(policy=policy, goal=(1.0, 0.0), robot=robot, limits=DriveLimitOptions(v_max=1.0)))


def test_what_is_no_policy_is_said(tmp_path):
    with pytest.raises(PolicyError, match=r"holds no policy\.toml"):
        drive(DriveOptions(policy=tmp_path, goal=(1.0, 0.0)))


LEARNED = RobotConfig(v_max_mps=0.9, w_max_radps=0.7, camera=CameraConfig(latency_s=0.1), camera_hz=10, control_hz=20)


def trained(**changes):
    return SimpleNamespace(spec=dataclasses.replace(PolicySpec(robot=LEARNED), **changes))


def test_limits_are_the_policys_unless_others_are_named():
    plain = command._config(trained(), DriveOptions(policy=Path()))
    assert (plain.v_max_mps, plain.w_max_radps, plain.goal_in_start_frame) == (0.9, 0.7, True)
    episode = command.settings_of_policy(trained().spec).episode
    assert (plain.goal_radius_m, plain.time_limit_s) == (episode.success_radius_m, episode.time_limit_s)
    own = command._config(
        trained(),
        DriveOptions(
            policy=Path(),
            limits=DriveLimitOptions(goal_frame="odom", goal_radius=0.4, time_limit=30.0, v_max=0.5, w_max=0.3),
        ),
    )
    assert (own.v_max_mps, own.w_max_radps, own.goal_radius_m, own.time_limit_s) == (0.5, 0.3, 0.4, 30.0)
    assert not own.goal_in_start_frame
    for radius_m, limit_s in ((0.0, 30.0), (0.4, 0.0)):
        with pytest.raises(ConfigError, match="--goal-radius and --time-limit must be positive"):
            command._config(
                trained(),
                DriveOptions(policy=Path(), limits=DriveLimitOptions(goal_radius=radius_m, time_limit=limit_s)),
            )


@pytest.mark.parametrize(("age_s", "told"), [(0.16, True), (0.14, False), (0.06, False), (0.04, True)])
def test_end_of_a_trial_is_told_with_rates_and_images_that_are_late(age_s, told):
    console = PlainConsole(file=io.StringIO(), width=300)
    measures = {
        "inference_hz": 9.96, "inference_hz_possible": 123.4, "command_hz": 19.97, "latency_median_ms": 4.56,
        "latency_p99_ms": 7.89, "frame_age_median_s": age_s,
    }  # fmt: skip
    command._tell(
        console, {"reason": "at the goal", "duration_s": 12.36, "driven_m": 7.89, "measures": measures}, LEARNED
    )
    lines = console.file.getvalue().splitlines()
    assert lines[:2] == [
        "at the goal after 12.4 s and 7.9 m",
        "inference 10.0 Hz (123 Hz possible), commands 20.0 Hz, image to command 4.6 ms, p99 7.9 ms",
    ]
    learned = f"images are {1000 * age_s:.0f} ms old when they come, the policy learned with 100 ms: train one with"
    steps_s = {0.16: "0.15", 0.04: "0.05"}.get(age_s)
    assert lines[2:] == ([f"{learned} latency_s = {steps_s} in [camera] of robot.toml"] if told else [])
    console = PlainConsole(file=io.StringIO(), width=300)
    command._tell(console, {"reason": "stopped", "duration_s": 0.0, "driven_m": 0.0, "measures": {}}, LEARNED)
    assert console.file.getvalue() == "stopped after 0.0 s and 0.0 m\n"


def test_image_of_the_goal_is_wanted_or_not(tmp_path):
    wants = SimpleNamespace(spec=SimpleNamespace(wants_goal_image=True))
    blind = SimpleNamespace(spec=SimpleNamespace(wants_goal_image=False))
    file, text = tmp_path / "goal.png", tmp_path / "goal.txt"
    bgr = np.full((4, 6, 3), (10, 20, 200), np.uint8)
    cv2.imwrite(str(file), bgr)
    text.write_text("no image")
    assert np.array_equal(command._goal_image(wants, file), bgr)
    assert command._goal_image(blind, None) is None
    for policy, path, words in (
        (blind, file, "leave --goal-image out"),
        (wants, None, "pass --goal-image FILE"),
        (wants, text, "is no JPEG or PNG image"),
        (wants, tmp_path / "none", "cannot be read: No such file"),
    ):
        with pytest.raises(ConfigError, match=words):
            command._goal_image(policy, path)


def test_camera_that_is_narrower_or_mounted_elsewhere_is_told():
    console = PlainConsole(file=io.StringIO(), width=300)
    learned = CameraConfig(height_px=72, width_px=128, horizontal_fov_deg=90.0)
    narrow = CameraConfig(height_px=480, width_px=640, horizontal_fov_deg=87.0, mount_height_m=0.9, mount_x_m=0.2)
    rectify = command._rectifier(learned, narrow, console)
    assert console.file.getvalue().splitlines() == [
        f"{100 * rectify.unseen:.1f} % of the policy's image is black: the robot's camera is narrower.",
        "The camera is mounted elsewhere than the policy's: mount_x_m 0 (the robot's: 0.2).",
        "The camera is mounted elsewhere than the policy's: mount_height_m 0.5 (the robot's: 0.9).",
    ]
    console = PlainConsole(file=io.StringIO(), width=300)
    command._rectifier(learned, learned, console)
    assert console.file.getvalue() == ""


def test_robot_is_waited_for_until_it_sends_what_is_asked_or_what_cannot_be_used(monkeypatch):
    now_s, asked = [0.0], []
    monkeypatch.setattr(
        command, "time", SimpleNamespace(monotonic=lambda: now_s[0], sleep=lambda s: now_s.__setitem__(0, now_s[0] + s))
    )
    robot = SimpleNamespace(broken="", absent=lambda: "", goal=None)
    answer = command._wait_for(robot, lambda: (asked.append(1), 7 if len(asked) > 3 else None)[1], "goal")
    assert (answer, len(asked)) == (7, 4)
    with pytest.raises(BusError, match="no goal after 10 s; pass --calibration FILE"):
        command._goal_of(robot, "/goal")
    assert now_s[0] == pytest.approx(10.06, abs=0.05)
    robot.absent = lambda: "no node publishes /goal"
    with pytest.raises(BusError, match="no goal after 10 s; no node publishes /goal"):
        command._goal_of(robot, "/goal")
    robot.broken = "/goal: 3 bytes"
    with pytest.raises(BusError, match="The robot sends what cannot be used: /goal: 3 bytes"):
        command._goal_of(robot, "/goal")


def test_signals_are_left_alone_while_the_robot_is_told_to_stand():
    before = signal.getsignal(signal.SIGINT)
    with command._ignore_interrupts():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt):
        command._hang_up(1, None)


def test_ctrl_c_before_a_trial_says_that_the_robot_is_not_driven(policy, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "connect_robot", lambda *_, **__: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(command, "_camera_of", interrupt)
    before = signal.getsignal(signal.SIGHUP)
    with pytest.raises(KeyboardInterrupt, match=r"^the robot is not driven\.$"):
        drive(DriveOptions(policy=policy, goal=(1.0, 0.0)))
    signal.signal(signal.SIGHUP, before)


class FailingRobot:
    """Sends an image and odometry at every call, and fails after a while."""

    broken = outcome = ""

    def __init__(self, calls):
        self.calls = calls

    def next_picture(self, until_s):
        time.sleep(0.005)
        self.calls -= 1
        if self.calls < 0:
            raise RunError("the robot is beyond the map")
        return picture(time.time_ns()), time.monotonic_ns()

    def beside(self):
        return []

    def odometry(self):
        return [(odometry(time.time_ns()), time.monotonic_ns())]

    def send(self, command):
        pass


@pytest.mark.parametrize(("calls", "kept"), [(12, True), (0, False)])
def test_trial_that_an_error_ends_is_logged_as_failed_if_it_had_begun(tmp_path, calls, kept):
    path, record = tmp_path / "trial.mcap", {"task": "static", "policy": "p", "time_limit_s": 9.0}
    console = PlainConsole(file=io.StringIO())
    with pytest.raises(RunError, match="beyond the map"):
        command._drive(FailingRobot(calls), Ride().pilot, 20, path, record, console, LEARNED, None)
    assert [file.name for file in tmp_path.iterdir()] == (["trial.mcap"] if kept else [])
    if kept:
        (trial,) = read_trials(tmp_path)
        assert (trial.record.category, trial.record.reason) == (Category.DRIVER_FAILED, "the robot is beyond the map")
        assert trial.record.result.duration_s > 0.05
        assert trial.measures["command_hz"] > 0


@pytest.mark.parametrize(("frame", "refused"), [("map", True), ("/odom", False), ("", False)])
def test_goal_of_another_frame_than_the_odometrys_is_refused(frame, refused):
    robot = SimpleNamespace(broken="", goal=GoalMessage(x_m=1.0, y_m=2.0, frame=frame), frame="odom")
    if not refused:
        assert command._goal_of(robot, "/goal_pose").x_m == 1.0
        return
    with pytest.raises(
        ConfigError, match=r"odometry's frame 'odom', got one in 'map' on /goal_pose: send it in 'odom'"
    ):
        command._goal_of(robot, "/goal_pose")


def test_cameras_of_one_namespace_are_refused_unless_their_infos_are_told_apart():
    named = {"rgb": "/rig/front/image_raw", "left.rgb": "/rig/left", "right.rgb": "/rig/right"}
    with pytest.raises(ConfigError, match=r"those of left and right are both /rig/camera_info, .* --calibration"):
        command._topics(DriveOptions(), named)
    assert command._topics(DriveOptions(calibration=Path("robot.toml")), named).infos == {}
    both = {"rgb": "/rig/front", "left.rgb": "/rig/left"}
    with pytest.raises(ConfigError, match="those of the first camera and left are both /rig/camera_info"):
        command._topics(DriveOptions(), both)
    told = command._topics(DriveOptions(topics=DriveTopicOptions(camera_info="/rig/front_info")), both)
    assert (told.camera_info, told.infos) == ("/rig/front_info", {"left": "/rig/camera_info"})
