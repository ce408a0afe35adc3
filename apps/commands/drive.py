"""`readygo drive`: a policy drives a robot."""

import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
from tyro.conf import Positional, UseAppendAction

from readygo.apps.drive.calibration import Rectifier, camera_from_file, camera_from_info, mount_differences
from readygo.apps.drive.messages import GoalMessage
from readygo.apps.drive.named_topics import check_infos, check_topics, image_topics, info_topics
from readygo.apps.drive.people import PeopleFinder
from readygo.apps.drive.perceiving import MakeDecider, PerceivingPolicy, acting, planning
from readygo.apps.drive.pilot import DriveConfig, Pilot, TrialEnding, limit_speeds
from readygo.apps.drive.robot import Robot, Topics, connect_robot
from readygo.apps.drive.trial import PATIENCE_S, Measures, run_trial, trial_end
from readygo.apps.drive.trial_log import TrialLog
from readygo.apps.drive.wires import WireName, make_wire
from readygo.apps.terminal import PlainConsole
from readygo.common.arrays import UInt8Array
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.camera import CameraConfig
from readygo.common.errors import BusError, ConfigError, PolicyError, ReadygoError, RunError
from readygo.common.files import read_regular
from readygo.common.images.encoded import decode_pixels
from readygo.common.images.names import RGB, cameras_of, image_name
from readygo.common.perception import Perception, load_perception
from readygo.common.policy import Policy, load_policy
from readygo.common.policy.sight import camera_on
from readygo.common.robot import RobotConfig, load_robot
from readygo.common.state_policy.robots import robot_difference
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.runs.config import RunConfig
from readygo.runs.origin import settings_of_policy
from readygo.runs.policy import policy_sha256
from readygo.runs.scene_argument import open_maps
from readygo.runs.state_world import state_world_of
from readygo.runs.teacher import teacher_ref
from readygo.services.planner import RobotPlanner

Value = TypeVar("Value")
TaskLabel = Literal["static", "dynamic", "reactive"]
_LATE_S = 0.05
"""Largest difference between the image latency of this robot and of the training without a message [s]."""
SENT_HZ = 20
"""Lowest rate of commands [Hz]; it keeps the robot's watchdog from stopping it."""


@dataclass(frozen=True, kw_only=True)
class DriveLimitOptions:
    """Limits of the trial and of the robot's motion."""

    goal_frame: Literal["start", "odom"] | None = None
    """Frame of `goal`: the robot's start pose, as by default, or "odom", the frame of the odometry."""
    goal_radius: float | None = None
    """Distance from the goal at which the robot has arrived [m]; by default as in the policy's training."""
    time_limit: float | None = None
    """Longest trial [s]; by default as in the policy's training."""
    v_max: float | None = None
    """Largest speed [m/s], at most the policy's."""
    w_max: float | None = None
    """Largest yaw rate [rad/s], at most the policy's."""
    rate_hz: float | None = None
    """Lowest rate of commands [Hz]; by default the control rate of the policy's robot, at least 20. Each image
    triggers a command immediately as well."""


@dataclass(frozen=True, kw_only=True)
class DriveTopicOptions:
    """Further topics of the robot."""

    depth: UseAppendAction[tuple[str, ...]] = ()
    """Topic of the depth images that the policy uses: Image in millimetres (16UC1) or metres (32FC1), or
    CompressedImage (compressedDepth), aligned to the images; NAME=/topic for further cameras."""
    odom: str = "/odom"
    """Topic of the Odometry."""
    cmd_vel: str = "/cmd_vel"
    """Topic of the commands, Twist, or TwistStamped if the robot subscribes to that."""
    camera_info: str = ""
    """Topic of the first camera's CameraInfo; by default next to its image topic, as for further cameras."""
    outcome_topic: str = ""
    """Topic of a String that ends the trial: success, timeout, static_collision or human_collision."""


@dataclass(frozen=True, kw_only=True)
class DrivePeopleOptions:
    """Perception of people and free space: beside the policy, or for the planner."""

    perception: Path | None = None
    """Folder of a network from `readygo train --recipe perception`: it perceives people and free distances in
    the first camera's images, ten times a second, and publishes them."""
    people: str = "/people"
    """Topic of the people, people_msgs/People in the odometry's frame, with `perception`."""
    scan: str = "/perception/scan"
    """Topic of the free distances, LaserScan in the robot's frame, with `perception`."""
    driver: Literal["policy", "perceive-and-plan", "perceive-and-act"] = "policy"
    """"perceive-and-plan" drives without a policy: the planner drives on the map of `scene` among the people that
    `perception` sees. "perceive-and-act": a policy from `readygo rl` decides there instead."""
    scene: str = ""
    """Scene bundle, "embedded", or a ROS map (.yaml) that planner or state policy drive on."""
    start: tuple[float, float, float] | None = None
    """Start pose in the scene: x, y [m], yaw [rad]; by default the odometry is in the scene's frame."""


@dataclass(frozen=True, kw_only=True)
class RosOptions:
    """Names of the robot in ROS."""

    domain: int = 0
    """ROS_DOMAIN_ID of the robot."""
    prefix: str = ""
    """Key prefix, behind a bridge with a namespace."""
    stamped: bool = False
    """Send TwistStamped behind a bridge."""


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """Drive a robot to a goal with a policy that sees its camera images; this machine needs no ROS.

    The robot is stopped while images or odometry are older than 0.3 s, and when the trial ends: at the goal, at the
    time limit, at Ctrl-C, or if a clock, the odometry or the policy is invalid. Keep its emergency stop at hand.
    """

    policy: Positional[Path | None] = None
    """Folder of a trained policy; with `driver` perceive-and-act one from `readygo rl`, with perceive-and-plan none."""
    goal: tuple[float, float] | None = None
    """Goal position, ahead and left of the robot's start pose [m]; see `goal_frame`."""
    goal_topic: str = ""
    """Topic of a PoseStamped goal in the odometry's frame, such as /goal_pose, instead of `goal`."""
    goal_image: Path | None = None
    """Image file of the camera's view at the goal, for a policy with image goals; the goal position still
    determines arrival."""
    robot: Path | None = None
    """robot.toml of this robot, for a policy trained for several robots (docs/learn.md)."""
    dry_run: bool = False
    """Print the commands instead of sending them."""
    image: UseAppendAction[tuple[str, ...]] = ()
    """Topic of the images, Image or CompressedImage, /camera/image_raw by default; --image NAME=/topic for each
    further camera that the policy uses."""
    calibration: Path | None = None
    """Calibration file instead of a CameraInfo: robot.toml, or .yaml of ROS's camera_calibration."""
    wire: WireName = "ros2"
    """Transport: "ros2" is rmw_zenoh, "bridge" zenoh-bridge-ros2dds, "plain" MessagePack without ROS
    (docs/robots.md)."""
    connect: str = "tcp/127.0.0.1:7447"
    """Endpoint of the robot's Zenoh router."""
    log: Path | None = None
    """MCAP file to record the trial in."""
    task: TaskLabel = "static"
    """Task under which `readygo evaluate --from-logs` counts the trial."""
    limits: DriveLimitOptions = field(default_factory=DriveLimitOptions)
    topics: DriveTopicOptions = field(default_factory=DriveTopicOptions)
    beside: DrivePeopleOptions = field(default_factory=DrivePeopleOptions)
    ros: RosOptions = field(default_factory=RosOptions)


def drive(options: DriveOptions) -> None:
    """Drive a robot to a goal with a policy that sees its camera images; this machine needs no ROS."""
    check_endpoint(options.connect, "--connect")
    console, perception = PlainConsole(soft_wrap=True), None
    if options.beside.perception is not None:
        perception = load_perception(options.beside.perception)
    policy = _driver(options, perception)
    robot, inputs = policy.spec.robot, policy.spec.images
    config = _config(policy, options)
    least_hz = max(SENT_HZ, robot.control_hz)
    rate_hz = options.limits.rate_hz
    if rate_hz is not None and rate_hz < least_hz:
        raise ConfigError(f"--rate-hz must be at least {least_hz}, got {rate_hz:g}.")
    if (options.goal is None) == (not options.goal_topic):
        raise ConfigError("Say where to go: either --goal X Y or --goal-topic TOPIC.")
    if options.goal_topic and options.limits.goal_frame:
        raise ConfigError(
            "--goal-frame is for --goal: goals of --goal-topic are in the odometry's frame; leave it out."
        )
    named = image_topics(options.image, options.topics.depth, robot)
    check_topics(named, inputs, robot)
    goal_image = _goal_image(policy, options.goal_image)
    signal.signal(signal.SIGHUP, _hang_up)
    ros, calibration = options.ros, options.calibration
    wire = make_wire(options.wire, domain=ros.domain, prefix=ros.prefix, stamped=ros.stamped, node="readygo_drive")
    cameras = {name: camera_on(robot, name) for name in cameras_of(inputs)}
    own: dict[str, CameraConfig] = {}
    if calibration:
        own = {
            name: camera_from_file(camera, calibration, name, named.get(image_name(name, RGB), ""))
            for name, camera in cameras.items()
        }
    machine = connect_robot(options.connect, wire, _topics(options, named), dry=options.dry_run)
    try:
        rectify = {
            name: _rectifier(camera, own[name] if own else _camera_of(camera, machine, name), console)
            for name, camera in cameras.items()
        }
        goal_topic = options.goal_topic
        where = GoalMessage(x_m=options.goal[0], y_m=options.goal[1]) if options.goal else _goal_of(machine, goal_topic)
        pilot = _pilot(policy, rectify, config, where, goal_image)
        record = {
            "policy": options.policy.resolve().name if options.policy else options.beside.driver,
            "policy_sha256": _hash_of(options),
            "task": options.task,
            "time_limit_s": config.time_limit_s,
        }
        people = _people_finder(perception, machine, calibration, named[RGB], console) if perception else None
        _drive(machine, pilot, rate_hz or least_hz, options.log, record, console, robot, people)
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(str(stop) or "the robot is not driven.") from None
    finally:
        with _ignore_interrupts():
            machine.close()


def _topics(options: DriveOptions, named: Mapping[str, str]) -> Topics:
    """All topics of the robot; `named` are those of its images."""
    infos = {} if options.calibration else info_topics(named)
    if options.topics.camera_info and not options.calibration:
        infos = {**infos, "": options.topics.camera_info}
    check_infos(infos)
    return Topics(
        image=named[RGB],
        odometry=options.topics.odom,
        command=options.topics.cmd_vel,
        camera_info=infos.get("", ""),
        goal=options.goal_topic,
        outcome=options.topics.outcome_topic,
        beside={name: topic for name, topic in named.items() if name != RGB},
        infos={name: topic for name, topic in infos.items() if name},
        people=options.beside.people if options.beside.perception else "",
        scan=options.beside.scan if options.beside.perception else "",
    )


def _driver(options: DriveOptions, perception: Perception | None) -> Policy:
    """The policy, or what drives on a map in its place.

    Raises:
        ConfigError: If options are missing, or have no effect.
        PolicyError: If the policy cannot be used.
        SceneError: If there is no such scene.
    """
    beside = options.beside
    if beside.driver == "policy":
        if options.policy is None:
            raise ConfigError("Name the policy: readygo drive POLICY, or --driver perceive-and-plan.")
        if beside.scene or beside.start:
            raise ConfigError("--scene and --start are for --driver perceive-and-plan and perceive-and-act.")
        return _load_policy(options.policy, options.robot)
    acts = beside.driver == "perceive-and-act"
    if options.robot is not None or (options.policy is not None and not acts):
        left_out = "--robot" if acts else "POLICY and --robot"
        raise ConfigError(f"--driver {beside.driver} drives the robot of its network: leave {left_out} out.")
    if perception is None or not beside.scene:
        raise ConfigError(f"--driver {beside.driver} needs --perception FOLDER and --scene SCENE.")
    maps, _ = open_maps(beside.scene)
    settings = RunConfig(robot=perception.spec.robot)
    planner = RobotPlanner(maps, {}, settings.robot, settings.episode, settings.expert)
    decider = _acting(options.policy, settings, planner) if acts else planning(planner)
    return PerceivingPolicy(perception, planner, decider, beside.start)


def _acting(folder: Path | None, settings: RunConfig, planner: RobotPlanner) -> MakeDecider:
    """A state policy, which decides on a map.

    Raises:
        ConfigError: If none is named.
        PolicyError: If it cannot be used, or was trained for another robot.
    """
    if folder is None:
        raise ConfigError("--driver perceive-and-act needs a policy: readygo drive FOLDER, from `readygo rl`.")
    policy = load_state_policy(folder)
    if difference := robot_difference(policy.spec.robot, settings.robot):
        raise PolicyError(f"{folder} was trained for another robot than perception ({difference}).")
    world = state_world_of(planner.maps, settings, policy.spec.observation)
    distances = GoalDistances(planner.maps.robot, settings.robot.planning_radius_m)
    return acting(policy, world, distances, planner)


def _hash_of(options: DriveOptions) -> str:
    """SHA-256 of the policy that drives; empty without one."""
    if options.policy is None:
        return ""
    if options.beside.driver == "policy":
        return policy_sha256(options.policy)
    return teacher_ref(options.policy).sha256


def _load_policy(folder: Path, robot: Path | None) -> Policy:
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
    people: PeopleFinder | None,
) -> None:
    log = TrialLog(path) if path else None
    if log is not None:
        robot.listen = log.put
    measures = Measures()

    def say(words: str) -> None:
        console.print(words, markup=False)

    try:
        run_trial(robot, pilot, rate_hz=rate_hz, say=say, people=people, measures=measures)
    except BaseException:
        # What went wrong matters more than a log that cannot be written.
        with suppress(ReadygoError, OSError):
            if log is not None and pilot.started_ns is None:
                log.abandon()
            elif log is not None:
                log.close({**record, **trial_end(pilot, measures)})
        raise
    end = trial_end(pilot, measures)
    if log is not None:
        log.close({**record, **end})
    _tell(console, end, learned)
    if pilot.ending is TrialEnding.STOPPED:
        raise KeyboardInterrupt(f"the robot stands{f'; the trial is in {path}' if path else ''}.")
    if pilot.ending not in (
        TrialEnding.GOAL,
        TrialEnding.LATE,
        TrialEnding.STATIC_COLLISION,
        TrialEnding.HUMAN_COLLISION,
    ):
        raise RunError(f"The robot was stopped: {pilot.reason}.")


def _config(policy: Policy, options: DriveOptions) -> DriveConfig:
    """The settings of a trial: those of the policy's training where none are given.

    Raises:
        ConfigError: If the limits are not the policy's.
    """
    limits = options.limits
    spec = policy.spec
    episode = settings_of_policy(spec).episode
    config = DriveConfig(
        v_max_mps=spec.robot.v_max_mps if limits.v_max is None else limits.v_max,
        w_max_radps=spec.robot.w_max_radps if limits.w_max is None else limits.w_max,
        goal_radius_m=episode.success_radius_m if limits.goal_radius is None else limits.goal_radius,
        time_limit_s=episode.time_limit_s if limits.time_limit is None else limits.time_limit,
        goal_in_start_frame=limits.goal_frame != "odom" and not options.goal_topic,
    )
    try:
        limit_speeds(spec.robot, config)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if not (config.goal_radius_m > 0 and config.time_limit_s > 0):
        raise ConfigError("--goal-radius and --time-limit must be positive.")
    return config


def _goal_image(policy: Policy, path: Path | None) -> UInt8Array | None:
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
    goal: GoalMessage,
    goal_image: UInt8Array | None,
) -> Pilot:
    try:
        return Pilot(policy, rectify, config, goal, goal_image)
    except ValueError as error:
        raise ConfigError(f"--goal-image has {error}.") from error


def _people_finder(
    perception: Perception, robot: Robot, calibration: Path | None, image: str, console: PlainConsole
) -> PeopleFinder:
    """Perception of people in the robot's first camera."""
    trained = perception.spec.robot.camera
    own = camera_from_file(trained, calibration, image=image) if calibration else _camera_of(trained, robot, "")
    return PeopleFinder(perception, _rectifier(trained, own, console, whose="the perception's"))


def _rectifier(
    trained: CameraConfig, own: CameraConfig, console: PlainConsole, *, whose: str = "the policy's"
) -> Rectifier:
    rectify = Rectifier(own, trained)
    if rectify.unseen > 0.005:
        console.print(f"{100 * rectify.unseen:.1f} % of {whose} image is black: the robot's camera is narrower.")
    for words in mount_differences(own, trained):
        console.print(f"The camera is mounted elsewhere than {whose}: {words}.")
    return rectify


def _camera_of(trained: CameraConfig, robot: Robot, name: str) -> CameraConfig:
    what = f"CameraInfo of {name}" if name else "CameraInfo"
    return camera_from_info(trained, _wait_for(robot, lambda: robot.cameras.get(name), what))


def _goal_of(robot: Robot, topic: str) -> GoalMessage:
    """The robot's goal.

    Raises:
        BusError: If none arrives.
        ConfigError: If it is not in the frame of the odometry.
    """
    goal = _wait_for(robot, lambda: robot.goal, "goal")
    if goal.frame:
        frame = _wait_for(robot, lambda: robot.frame, "odometry")
        if frame and goal.frame.strip("/") != frame.strip("/"):
            raise ConfigError(
                f"Goals must be in the odometry's frame {frame!r}, got one in {goal.frame!r} on {topic}: send it in "
                f"{frame!r}, or name an odometry in {goal.frame!r} with --odom."
            )
    return goal


def _wait_for(robot: Robot, ask: Callable[[], Value | None], name: str) -> Value:
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
def _ignore_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C while the robot gets its last command."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
