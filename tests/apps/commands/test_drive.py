"""`readygo drive` against a robot on a network of its own, and what it says to those who ask for nonsense."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing

import numpy as np
import pytest

from readygo.apps.commands.drive import drive
from readygo.apps.drive.calibration import info_of
from readygo.apps.drive.messages import Command
from readygo.apps.drive.ros_codec import IMAGE_TYPE, TWIST_TYPE, RosCodec
from readygo.apps.drive.trial_log import RECORD
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.dataset.ros_log import read_record
from readygo.common.errors import BusError, ConfigError, PolicyError
from tests.apps.drive.conftest import CAMERA, odometry
from tests.common.policy.artifacts import write_policy

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
    drive(policy, goal=(5.0, 0.0), time_limit=0.6, wire="bridge", connect=endpoint, log=path, task="dynamic")
    out = capsys.readouterr().out
    assert "out of time after 0." in out
    assert "Hz possible), commands" in out
    assert told[-1] == Command()
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
    assert told[-1] == Command()
    assert read_record(log, RECORD)["ending"] == "stopped"


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, ConfigError, "either --goal X Y or --goal-topic"),
        ({"goal": (1.0, 0.0), "goal_topic": "/goal_pose"}, ConfigError, "either --goal X Y or --goal-topic"),
        ({"goal": (1.0, 0.0), "v_max": 3.0}, ConfigError, "at most 1, what the policy learned, got 3"),
        ({"goal": (1.0, 0.0), "rate_hz": 5.0}, ConfigError, "--rate-hz must be at least 20"),
        ({"goal": (1.0, 0.0), "connect": "tcp/127.0.0.1:1"}, BusError, "No Zenoh router answers at tcp/127.0.0.1:1"),
    ],
)
def test_what_makes_no_trial_is_said(policy, options, error, words):
    with pytest.raises(error, match=words):
        drive(policy, **options)


def test_policy_for_several_robots_wants_to_know_which_one_it_drives(policy, tmp_path):
    text = (policy / "policy.toml").read_text()
    (policy / "policy.toml").write_text(text.replace("v_max_mps = []", "v_max_mps = [0.5, 1.2]"))
    with pytest.raises(ConfigError, match="knows several robots: say which one it drives with --robot"):
        drive(policy, goal=(1.0, 0.0))
    robot = tmp_path / "robot.toml"
    robot.write_text("v_max_mps = 1.5\n")
    with pytest.raises(PolicyError, match=r"other ranges: v_max_mps 1\.5 \(the policy's: 0\.5 to 1\.2\)"):
        drive(policy, goal=(1.0, 0.0), robot=robot)
    robot.write_text("v_max_mps = 0.8\n")
    with pytest.raises(ConfigError, match=r"at most 0\.8, what the policy learned, got 1"):
        drive(policy, goal=(1.0, 0.0), robot=robot, v_max=1.0)


def test_what_is_no_policy_is_said(tmp_path):
    with pytest.raises(PolicyError, match=r"holds no policy\.toml"):
        drive(tmp_path, goal=(1.0, 0.0))
