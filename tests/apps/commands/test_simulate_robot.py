import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader

from readygo.apps.cli import run_command
from readygo.apps.commands.simulate_robot import (
    SimulateRobotOptions,
    _check_suffixes,
    _drive_all,
    _topics,
    _without_latency,
    simulate_robot,
)
from readygo.apps.drive.robot import Topics
from readygo.apps.drive.simulated import Manners
from readygo.apps.drive.trial import OUTCOMES
from readygo.apps.drive.trial_log import RECORD
from readygo.commands import COMMANDS
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.dataset.ros_log import read_record
from readygo.common.errors import ConfigError
from readygo.common.messages import Outcome
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.runs.config import RunConfig
from readygo.services.evaluator import Task
from tests.common.policy.artifacts import write_policy

COMPRESSED = "sensor_msgs/msg/CompressedImage"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"manners": Manners(camera_hz=30.0)}, "20 Hz divided by a whole number, got 30"),
        (
            {"manners": Manners(compressed=True), "wire": "bridge"},
            r"end in /compressed or /compressedDepth, got /camera/image_raw\.",
        ),
    ],
)
def test_manners_that_no_robot_has_are_refused_before_anything_is_loaded(options, words):
    with pytest.raises(ConfigError, match=words):
        simulate_robot(SimulateRobotOptions(scene="no such scene", **options))


def test_share_of_lost_images_that_cannot_be_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(COMMANDS, ["simulate-robot", "embedded", "--drop-share", "1.5"])
    said = capsys.readouterr().err
    assert (stopped.value.code, said.count("\n")) == (2, 1)
    assert "the share of lost images 0..1" in said


def begin(*words: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "readygo", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("wire", ["ros2", "bridge"])
def test_two_programs_drive_by_compressed_images_and_depths(tmp_path: Path, wire: str) -> None:
    pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
    policy = str(write_policy(tmp_path / "policy", ("rgb", "depth")))
    endpoint, log = free_endpoint(), tmp_path / "trial.mcap"
    settings = tmp_path / "run.toml"
    settings.write_text("[episode]\ntime_limit_s = 2.0\n")
    images = ("--image", "/camera/image_raw/compressed", "--depth", "/camera/depth/image_raw/compressedDepth")
    both = (*images, "--wire", wire)
    robot = begin(
        *("simulate-robot", "embedded", policy, "--compressed", "--config", str(settings), "--listen", endpoint), *both
    )
    try:
        assert robot.stdout is not None
        assert "a robot waits" in robot.stdout.readline()
        goal = ("--goal-topic", "/goal_pose", "--outcome-topic", "/outcome")
        drive = begin("drive", policy, *goal, "--connect", endpoint, "--log", str(log), *both)
        said, wrong = drive.communicate(timeout=60.0)
        assert drive.returncode == 0, wrong
        assert "image to command" in said
        simulated, wrong = robot.communicate(timeout=60.0)
        assert robot.returncode == 0, wrong
        (outcome,) = re.findall(r"static test-0-0*: (\w+) after", simulated)
    finally:
        robot.send_signal(signal.SIGINT)
        robot.communicate()
    with log.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        types = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    assert {topic for topic, type_name in types.items() if type_name == COMPRESSED} == {images[1], images[3]}
    record = read_record(log, RECORD)
    assert (record["ending"], record["left_out"]) == (OUTCOMES[outcome].name.lower(), 0)


def test_every_image_has_its_topic_and_every_camera_its_info() -> None:
    named = {"rgb": "/front/image", "depth": "/front/depth", "left.rgb": "/left/image"}
    topics = _topics(named, "/odom", "/cmd")
    assert topics == Topics(
        image="/front/image",
        odometry="/odom",
        command="/cmd",
        camera_info="/front/camera_info",
        goal="/goal_pose",
        outcome="/outcome",
        beside={"depth": "/front/depth", "left.rgb": "/left/image"},
        infos={"left": "/left/camera_info"},
    )
    _check_suffixes(["/a/compressed", "/b/compressedDepth"])
    with pytest.raises(ConfigError, match="got /b/raw"):
        _check_suffixes(["/a/compressed", "/b/raw"])


def test_cameras_are_not_late_themselves() -> None:
    late = CameraConfig(latency_s=0.1, mount_pitch_deg=3.0)
    robot = RobotConfig(camera=late, cameras={"left": late})
    punctual = CameraConfig(latency_s=0.0, mount_pitch_deg=3.0)
    assert _without_latency(RunConfig(robot=robot)).robot == RobotConfig(camera=punctual, cameras={"left": punctual})


def test_episodes_are_told_as_they_end() -> None:
    said: list[str] = []
    console = SimpleNamespace(print=lambda words, markup: said.append(words))
    scenarios = [SimpleNamespace(episode=SimpleNamespace(episode_id=name)) for name in ("e1", "e2", "e3")]
    episodes = [SimpleNamespace(task=Task.DYNAMIC, scenario=scenario) for scenario in scenarios]
    outcomes = iter([Outcome.SUCCESS, Outcome.TIMEOUT, Outcome.SUCCESS])
    evaluator = SimpleNamespace(simulation=lambda episode: SimpleNamespace(time_s=12.345))
    found = _drive_all(lambda simulation: next(outcomes), evaluator, episodes, console)  # type: ignore[arg-type]
    assert found == {Outcome.SUCCESS: 2, Outcome.TIMEOUT: 1}
    assert said == [
        f"dynamic e{k}: {word} after 12.35 s" for k, word in ((1, "success"), (2, "timeout"), (3, "success"))
    ]
