"""`readygo drive`: a policy drives a robot."""

import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from readygo.apps.cli import Group, Repeated
from readygo.apps.drive.calibration import Rectifier, camera_from_file, camera_from_info, mount_differences
from readygo.apps.drive.messages import Goal
from readygo.apps.drive.named_topics import check_topics, image_topics, info_topics
from readygo.apps.drive.pilot import DriveConfig, Ending, Pilot, limited
from readygo.apps.drive.robot import Robot, Topics, connected
from readygo.apps.drive.trial import PATIENCE_S, ended, run_trial
from readygo.apps.drive.trial_log import TrialLog
from readygo.apps.drive.wires import WireName, make_wire
from readygo.apps.run.origin import settings_of_policy
from readygo.apps.run.policy import policy_sha256
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.camera import CameraConfig
from readygo.common.errors import BusError, ConfigError, RunError
from readygo.common.files import read_regular
from readygo.common.images.encoded import decode_pixels
from readygo.common.images.names import RGB, cameras_of
from readygo.common.policy import Policy, load_policy
from readygo.common.policy.sight import camera_on
from readygo.common.robot import RobotConfig, load_robot

Value = TypeVar("Value")
TaskLabel = Literal["static", "dynamic", "reactive"]
_LATE_S = 0.05
"""Largest difference between the image latency of this robot and of the training without a message [s]."""
SENT_HZ = 20
"""Lowest rate of commands [Hz]; it keeps the robot's watchdog from stopping it."""


def drive(
    policy: Path,
    /,
    *,
    goal: tuple[float, float] | None = None,
    goal_frame: Literal["start", "odom"] = "start",
    goal_topic: str = "",
    goal_image: Path | None = None,
    goal_radius: float | None = None,
    time_limit: float | None = None,
    v_max: float | None = None,
    w_max: float | None = None,
    rate_hz: float | None = None,
    robot: Path | None = None,
    dry_run: bool = False,
    image: Annotated[tuple[str, ...], Group("connection"), Repeated()] = (),
    depth: Annotated[tuple[str, ...], Group("connection"), Repeated()] = (),
    odom: Annotated[str, Group("connection")] = "/odom",
    cmd_vel: Annotated[str, Group("connection")] = "/cmd_vel",
    camera_info: Annotated[str, Group("connection")] = "",
    calibration: Annotated[Path | None, Group("connection")] = None,
    wire: Annotated[WireName, Group("connection")] = "ros2",
    connect: Annotated[str, Group("connection")] = "tcp/127.0.0.1:7447",
    domain: Annotated[int, Group("connection")] = 0,
    prefix: Annotated[str, Group("connection")] = "",
    stamped: Annotated[bool, Group("connection")] = False,
    log: Annotated[Path | None, Group("trial")] = None,
    task: Annotated[TaskLabel, Group("trial")] = "static",
    outcome_topic: Annotated[str, Group("trial")] = "",
) -> None:
    """Drive a robot to a goal with a policy that sees its camera images; this machine needs no ROS.

    The robot is stopped while images or odometry are older than 0.3 s, and when the trial ends: at the goal, at the
    time limit, at Ctrl-C, or if a clock, the odometry or the policy is invalid. Keep its emergency stop at hand.

    Args:
        policy: Folder of a trained policy.
        goal: Goal position, ahead and left of the robot's start pose [m]; see `goal_frame`.
        goal_frame: Frame of `goal`: the robot's start pose, or "odom", the frame of the odometry.
        goal_topic: Topic of a PoseStamped goal in the odometry's frame, such as /goal_pose, instead of `goal`.
        goal_image: Image file of the camera's view at the goal, for a policy with image goals; the goal position still
            determines arrival.
        goal_radius: Distance from the goal at which the robot has arrived [m]; by default as in the policy's training.
        time_limit: Longest trial [s]; by default as in the policy's training.
        v_max: Largest speed [m/s], at most the policy's.
        w_max: Largest yaw rate [rad/s], at most the policy's.
        rate_hz: Lowest rate of commands [Hz]; by default the control rate of the policy's robot, at least 20. Each
            image triggers a command immediately as well.
        robot: robot.toml of this robot, for a policy trained for several robots (docs/learn.md).
        dry_run: Print the commands instead of sending them.
        image: Topic of the images, Image or CompressedImage, /camera/image_raw by default; --image NAME=/topic for each
            further camera that the policy uses.
        depth: Topic of the depth images that the policy uses: Image in millimetres (16UC1) or metres (32FC1), or
            CompressedImage (compressedDepth), aligned to the images; NAME=/topic for further cameras.
        odom: Topic of the Odometry.
        cmd_vel: Topic of the commands, Twist, or TwistStamped if the robot subscribes to that.
        camera_info: Topic of the first camera's CameraInfo; by default next to its image topic, as for further cameras.
        calibration: Calibration file instead of a CameraInfo: robot.toml, or .yaml of ROS's camera_calibration.
        wire: Transport: "ros2" is rmw_zenoh, "bridge" zenoh-bridge-ros2dds, "plain" MessagePack without ROS
            (docs/robots.md).
        connect: Endpoint of the robot's Zenoh router.
        domain: ROS_DOMAIN_ID of the robot.
        prefix: Key prefix, behind a bridge with a namespace.
        stamped: Send TwistStamped behind a bridge.
        log: MCAP file to record the trial in.
        task: Task under which `readygo evaluate --from-logs` counts the trial.
        outcome_topic: Topic of a String that ends the trial: success, timeout, static_collision or human_collision.

    Raises:
        ReadygoError: If policy, robot or calibration cannot be used.
    """
    check_endpoint(connect, "--connect")
    loaded, console = _loaded(policy, robot), PlainConsole(soft_wrap=True)
    in_start_frame = goal_frame == "start" and not goal_topic
    config = _config(loaded, in_start_frame, goal_radius, time_limit, v_max, w_max)
    least_hz = max(SENT_HZ, loaded.spec.robot.control_hz)
    if rate_hz is not None and rate_hz < least_hz:
        raise ConfigError(f"--rate-hz must be at least {least_hz}, got {rate_hz:g}.")
    if (goal is None) == (not goal_topic):
        raise ConfigError("Say where to go: either --goal X Y or --goal-topic TOPIC.")
    named = image_topics(image, depth, loaded.spec.robot)
    check_topics(named, loaded.spec.images, loaded.spec.robot)
    shown = _goal_image(loaded, goal_image)
    infos = {} if calibration else {**info_topics(named), **({"": camera_info} if camera_info else {})}
    topics = Topics(
        image=named.pop(RGB),
        odometry=odom,
        command=cmd_vel,
        camera_info=infos.pop("", ""),
        goal=goal_topic,
        outcome=outcome_topic,
        beside=named,
        infos=infos,
    )
    signal.signal(signal.SIGHUP, _hang_up)
    spoken = make_wire(wire, domain=domain, prefix=prefix, stamped=stamped, node="readygo_drive")
    cameras = {name: camera_on(loaded.spec.robot, name) for name in cameras_of(loaded.spec.images)}
    own = {name: camera_from_file(camera, calibration, name) for name, camera in cameras.items()} if calibration else {}
    machine = connected(connect, spoken, topics, dry=dry_run)
    try:
        rectify = {
            name: _rectifier(camera, own[name] if own else _camera_of(camera, machine, name), console)
            for name, camera in cameras.items()
        }
        where = Goal(x_m=goal[0], y_m=goal[1]) if goal else _goal_of(machine)
        pilot = _pilot(loaded, rectify, config, where, shown)
        record = {
            "policy": policy.resolve().name,
            "policy_sha256": policy_sha256(policy),
            "task": task,
            "time_limit_s": config.time_limit_s,
        }
        _drive(machine, pilot, rate_hz or least_hz, log, record, console, loaded.spec.robot)
    finally:
        with _undisturbed():
            machine.close()


def _loaded(folder: Path, robot: Path | None) -> Policy:
    """Load the policy for the robot that it drives.

    Raises:
        ConfigError: If the policy was trained for several robots and none is named.
        PolicyError: If the policy cannot be used, or was not trained for this robot.
    """
    policy = load_policy(folder)
    if robot is not None:
        policy = policy.for_robot(load_robot(robot, cameras_of=policy.spec.robot))
    if policy.spec.robot.ranges.varies:
        raise ConfigError("The policy knows several robots: say which one it drives with --robot robot.toml.")
    return policy


def _drive(
    robot: Robot,
    pilot: Pilot,
    rate_hz: float,
    path: Path | None,
    record: dict[str, Any],
    console: PlainConsole,
    learned: RobotConfig,
) -> None:
    log = TrialLog(path) if path else None
    if log is not None:
        robot.listen = log.put
    try:
        measures = run_trial(robot, pilot, rate_hz=rate_hz, say=lambda words: console.print(words, markup=False))
    except BusError:
        if log is not None:
            log.abandon()
        raise
    end = ended(pilot, measures)
    if log is not None:
        log.close({**record, **end})
    _tell(console, end, learned)
    if pilot.ending is Ending.STOPPED:
        raise KeyboardInterrupt(f"the robot stands{f'; the trial is in {path}' if path else ''}.")
    if pilot.ending not in (Ending.GOAL, Ending.LATE, Ending.STATIC_COLLISION, Ending.HUMAN_COLLISION):
        raise RunError(f"The robot was stopped: {pilot.reason}.")


def _config(
    policy: Policy,
    in_start_frame: bool,
    goal_radius_m: float | None,
    time_limit_s: float | None,
    v_max_mps: float | None,
    w_max_radps: float | None,
) -> DriveConfig:
    """The settings of a trial: those of the policy's training where none are given.

    Raises:
        ConfigError: If the limits are not the policy's.
    """
    spec = policy.spec
    episode = settings_of_policy(spec).episode
    config = DriveConfig(
        v_max_mps=spec.robot.v_max_mps if v_max_mps is None else v_max_mps,
        w_max_radps=spec.robot.w_max_radps if w_max_radps is None else w_max_radps,
        goal_radius_m=episode.success_radius_m if goal_radius_m is None else goal_radius_m,
        time_limit_s=episode.time_limit_s if time_limit_s is None else time_limit_s,
        goal_in_start_frame=in_start_frame,
    )
    try:
        limited(spec.robot, config)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if not (config.goal_radius_m > 0 and config.time_limit_s > 0):
        raise ConfigError("--goal-radius and --time-limit must be positive.")
    return config


def _goal_image(policy: Policy, path: Path | None) -> npt.NDArray[np.uint8] | None:
    """The pixels of the goal image (BGR), shape (H, W, 3); None if the policy does not use one.

    Raises:
        ConfigError: If the image is missing, not used by the policy, or unreadable.
    """
    if policy.spec.wants_goal_image != (path is not None):
        raise ConfigError(
            "The policy wants no image of the goal: leave --goal-image out."
            if path
            else "The policy wants to see the goal: pass --goal-image FILE, as the robot's camera shows it there."
        )
    if path is None:
        return None
    try:
        pixels = decode_pixels(read_regular(path), cv2.IMREAD_COLOR)
    except OSError as error:
        raise ConfigError(f"--goal-image {path} cannot be read: {error.strerror}.") from error
    if pixels is None:
        raise ConfigError(f"--goal-image {path} is no JPEG or PNG image.")
    return pixels


def _pilot(
    policy: Policy,
    rectify: Mapping[str, Rectifier],
    config: DriveConfig,
    goal: Goal,
    goal_image: npt.NDArray[np.uint8] | None,
) -> Pilot:
    try:
        return Pilot(policy, rectify, config, goal, goal_image)
    except ValueError as error:
        raise ConfigError(f"--goal-image has {error}.") from error


def _rectifier(trained: CameraConfig, own: CameraConfig, console: PlainConsole) -> Rectifier:
    rectify = Rectifier(own, trained)
    if rectify.unseen > 0.005:
        console.print(f"{100 * rectify.unseen:.1f} % of the policy's image is black: the robot's camera is narrower.")
    for words in mount_differences(own, trained):
        console.print(f"The camera is mounted elsewhere than the policy's: {words}.")
    return rectify


def _camera_of(trained: CameraConfig, robot: Robot, name: str) -> CameraConfig:
    what = f"CameraInfo of {name}" if name else "CameraInfo"
    return camera_from_info(trained, _awaited(robot, lambda: robot.cameras.get(name), what))


def _goal_of(robot: Robot) -> Goal:
    return _awaited(robot, lambda: robot.goal, "goal")


def _awaited(robot: Robot, ask: Callable[[], Value | None], name: str) -> Value:
    until_s = time.monotonic() + PATIENCE_S
    while (value := ask()) is None:
        if robot.broken:
            raise BusError(f"The robot sends what cannot be used: {robot.broken}.")
        if time.monotonic() > until_s:
            why = robot.absent() or "pass --calibration FILE, or the topic with --camera-info"
            raise BusError(f"The robot cannot be driven: no {name} after {PATIENCE_S:g} s; {why}.")
        time.sleep(0.02)
    return value


def _tell(console: PlainConsole, end: Mapping[str, Any], learned: RobotConfig) -> None:
    """Print the outcome, the rates and the latencies of a trial."""
    console.print(f"{end['reason']} after {end['duration_s']:.1f} s and {end['driven_m']:.1f} m", markup=False)
    measures = end["measures"]
    if not measures:
        return
    console.print(
        "inference {inference_hz:.1f} Hz ({inference_hz_possible:.0f} Hz possible), commands {command_hz:.1f} Hz, "
        "image to command {latency_median_ms:.1f} ms, p99 {latency_p99_ms:.1f} ms".format(**measures)
    )
    age_s, latency_s, clock = measures["frame_age_median_s"], learned.camera.latency_s, learned.clock
    if abs(age_s - latency_s) > _LATE_S:
        console.print(
            f"images are {1e3 * age_s:.0f} ms old when they come, the policy learned with {1e3 * latency_s:.0f} ms: "
            f"train one with latency_s = {clock.dt_s * clock.steps(age_s):g} in [camera] of robot.toml",
            markup=False,
        )


def _hang_up(number: int, frame: object) -> None:
    """Stop as at Ctrl-C when the terminal closes."""
    raise KeyboardInterrupt


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ignore Ctrl-C while the robot gets its last command."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
