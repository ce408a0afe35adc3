"""`readygo simulate-robot`: a simulated robot to test policies with."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from tyro.conf import Positional, UseAppendAction

from readygo.apps.drive.calibration import Rectifier, info_of
from readygo.apps.drive.messages import GoalMessage
from readygo.apps.drive.named_topics import image_topics, info_topics
from readygo.apps.drive.pilot import DriveConfig, Pilot
from readygo.apps.drive.rehearsal import simulate_drive
from readygo.apps.drive.robot import Topics
from readygo.apps.drive.simulated import Look, Manners, SimulatedRobot
from readygo.apps.drive.wires import COMPRESSED_DEPTH_SUFFIX, COMPRESSED_SUFFIX, WireName, make_wire
from readygo.apps.terminal import PlainConsole
from readygo.common.arrays import AnyArray
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router
from readygo.common.episode import EpisodeSimulation
from readygo.common.errors import ConfigError
from readygo.common.images.names import RGB, cameras_of
from readygo.common.messages import Outcome, Split
from readygo.common.policy import PolicySpec, load_policy, load_spec
from readygo.common.policy.sight import camera_on
from readygo.common.robot import load_robot
from readygo.runs.config import RunConfig, SimulationKeys
from readygo.runs.evaluation import (
    evaluation_config,
    evaluation_world,
    make_evaluator,
    make_request,
)
from readygo.runs.origin import avatars_of_policy
from readygo.services.evaluator import Evaluator, Eyes, MatchedEpisode


@dataclass(frozen=True, kw_only=True)
class RobotPeopleOptions:
    """Episodes and pedestrians."""

    split: Literal["train", "val", "test"] = "test"
    """Split that the episodes are drawn from."""
    avatars: Path | None = None
    """Avatar file or folder of avatars; by default those of the policy's data, else the embedded ones."""


@dataclass(frozen=True, kw_only=True)
class RobotTopicOptions:
    """Further topics of the robot."""

    depth: UseAppendAction[tuple[str, ...]] = ()
    """Topic of depth images (16UC1), such as /camera/depth, NAME=/topic for further cameras; by default the robot
    has no depth camera."""
    odom: str = "/odom"
    """Topic of the Odometry."""
    cmd_vel: str = "/cmd_vel"
    """Topic of the commands."""
    domain: int = 0
    """ROS_DOMAIN_ID."""


@dataclass(frozen=True, kw_only=True)
class SimulateRobotOptions:
    """Simulate a robot in a scene in real time: publish images and odometry, and follow cmd_vel.

    The episodes are those of `readygo evaluate SCENE POLICY`. An episode begins with the first command of `readygo
    drive POLICY --goal-topic /goal_pose --outcome-topic /outcome`, and the next one begins after the commands have
    stopped.
    """

    scene: Positional[str]
    """Scene bundle, "embedded", "embedded:SEED" or "embedded:plan-SEED"."""
    policy: Positional[Path | None] = None
    """Folder of a trained policy: robot, avatars and settings are those of its data."""
    episodes: int = 1
    """Episodes per task."""
    tasks: tuple[Literal["static", "dynamic", "reactive"], ...] = ("static",)
    """Tasks, as in `readygo evaluate`."""
    seed: int = 0
    """Seed of the episodes."""
    robot: Path | None = None
    """robot.toml; its camera may differ from the policy's."""
    config: Path | None = None
    """TOML file with sections of settings; `--SECTION.KEY VALUE` overrides it."""
    rehearse: bool = False
    """Offline simulation: the policy drives in this process, as in `readygo drive`, in simulated time and without
    a network."""
    image: UseAppendAction[tuple[str, ...]] = ()
    """Topic of the images, /camera/image_raw by default; --image NAME=/topic for each further camera, by default
    /NAME/image_raw."""
    wire: WireName = "ros2"
    """Transport, as in `readygo drive`."""
    listen: str = "tcp/127.0.0.1:7447"
    """Endpoint of the Zenoh router that this command opens."""
    people: RobotPeopleOptions = field(default_factory=RobotPeopleOptions)
    manners: Manners = field(default_factory=Manners)
    topics: RobotTopicOptions = field(default_factory=RobotTopicOptions)
    keys: SimulationKeys = field(default_factory=dict)


def simulate_robot(options: SimulateRobotOptions) -> None:
    """Simulate a robot in a scene in real time: publish images and odometry, and follow cmd_vel."""
    check_endpoint(options.listen, "--listen")
    console, manners = PlainConsole(soft_wrap=True), options.manners
    spec = load_spec(options.policy) if options.policy else None
    settings = _settings(options, spec)
    manners.image_every(settings.robot.clock)
    named = image_topics(options.image, options.topics.depth, settings.robot, every_camera=True)
    if manners.compressed and options.wire == "bridge":
        _check_suffixes(named.values())
    people = avatars_of_policy(spec) if spec and options.people.avatars is None else options.people.avatars
    split = Split(options.people.split)
    world = evaluation_world(options.scene, settings, avatars=people, seed=options.seed, split=split)
    evaluator = make_evaluator(world, renderer=world.renderer(), methods={})
    request = make_request(options.episodes, options.tasks, ("policy",), split, options.seed)
    drawn, _ = evaluator.source().draw(
        seed=options.seed, split=request.split, count=options.episodes, tasks=request.tasks
    )
    sees = spec.images if options.rehearse and spec is not None else tuple(named)
    eyes, rng = evaluator.eyes(sees), np.random.default_rng(options.seed)
    eyes.look([evaluator.simulation(drawn[0])])

    def look(simulation: EpisodeSimulation) -> dict[str, AnyArray]:
        return {name: images[0] for name, images in eyes.measure([simulation]).items()}

    with ExitStack() as stack:
        machine = None
        if options.rehearse:
            run = _rehearsal(options.policy, settings, look, manners, rng, eyes)
        else:
            infos = {name: info_of(camera_on(settings.robot, name)) for name in cameras_of(named)}
            topics = _topics(named, options.topics.odom, options.topics.cmd_vel)
            stack.enter_context(closing(Router(options.listen)))
            session = stack.enter_context(closing(ForeignSession(options.listen)))
            domain = options.topics.domain
            wire = make_wire(options.wire, domain=domain, prefix="", stamped=False, node="readygo_robot")
            machine = SimulatedRobot(session, wire, topics, infos, look, manners, rng)
            console.print(f"a robot waits at {options.listen}", markup=False)
            run = machine.drive
        found = {
            task: _drive_all(run, evaluator, [e for e in drawn if e.task is task], console) for task in request.tasks
        }
    for task, outcomes in found.items():
        console.print(f"{task.value}: {outcomes[Outcome.SUCCESS]} of {outcomes.total()} succeed")
    if machine and machine.behind:
        console.print(f"this machine was too slow for real time {machine.behind} times")


def _settings(options: SimulateRobotOptions, policy: PolicySpec | None) -> RunConfig:
    """The settings of the episodes; the camera has no latency, the simulated transport adds it.

    Raises:
        ConfigError: If the robot's parameters are ranges.
    """
    robot = load_robot(options.robot) if options.robot else None
    settings = evaluation_config(
        policy,
        "robot" if robot else "policy",
        config=options.config,
        robot=robot,
        sensor=None,
        humans=None,
        keys=options.keys,
    )
    if settings.robot.ranges.varies:
        raise ConfigError("A simulated robot is one robot: name it with --robot robot.toml, without [ranges].")
    return _without_latency(settings)


def _drive_all(
    run: Callable[[EpisodeSimulation], Outcome],
    evaluator: Evaluator,
    episodes: Sequence[MatchedEpisode],
    console: PlainConsole,
) -> Counter[Outcome]:
    """Run a task's episodes, print each outcome, and count them."""
    outcomes: Counter[Outcome] = Counter()
    for episode in episodes:
        simulation = evaluator.simulation(episode)
        outcome = run(simulation)
        outcomes[outcome] += 1
        name = episode.scenario.episode.episode_id
        console.print(f"{episode.task.value} {name}: {outcome.value} after {simulation.time_s:.2f} s", markup=False)
    return outcomes


def _rehearsal(
    folder: Path | None, settings: RunConfig, look: Look, manners: Manners, rng: np.random.Generator, eyes: Eyes
) -> Callable[[EpisodeSimulation], Outcome]:
    """A function that lets a policy drive an episode in simulated time.

    Raises:
        ConfigError: If there is no policy.
    """
    if folder is None:
        raise ConfigError("A rehearsal needs a policy: readygo simulate-robot SCENE POLICY --rehearse.")
    policy = load_policy(folder)
    if policy.spec.robot.ranges.varies:
        policy = policy.for_robot(settings.robot)
    rectify = {
        name: Rectifier(camera_on(settings.robot, name), camera_on(policy.spec.robot, name))
        for name in cameras_of(policy.spec.images)
    }
    config = DriveConfig(
        v_max_mps=settings.robot.v_max_mps,
        w_max_radps=settings.robot.w_max_radps,
        goal_radius_m=settings.episode.success_radius_m,
        time_limit_s=settings.episode.time_limit_s,
        goal_in_start_frame=False,
    )

    def run(simulation: EpisodeSimulation) -> Outcome:
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        shown = None
        if policy.spec.wants_goal_image:
            shown = np.ascontiguousarray(eyes.goal_image(simulation)[..., ::-1])
        pilot = Pilot(policy, rectify, config, GoalMessage(x_m=goal_x, y_m=goal_y), shown)
        return simulate_drive(pilot, simulation, look, manners, rng)

    return run


def _topics(named: Mapping[str, str], odom: str, cmd_vel: str) -> Topics:
    infos = info_topics(named)
    return Topics(
        image=named[RGB],
        odometry=odom,
        command=cmd_vel,
        camera_info=infos.pop(""),
        goal="/goal_pose",
        outcome="/outcome",
        beside={name: topic for name, topic in named.items() if name != RGB},
        infos=infos,
    )


def _check_suffixes(topics: Iterable[str]) -> None:
    """Raise ConfigError unless each topic ends in a suffix of compressed images; a bridge conveys no other hint."""
    for topic in topics:
        if not topic.endswith((COMPRESSED_SUFFIX, COMPRESSED_DEPTH_SUFFIX)):
            raise ConfigError(
                f"Behind a bridge topics of compressed images end in {COMPRESSED_SUFFIX} or {COMPRESSED_DEPTH_SUFFIX}, "
                f"got {topic}."
            )


def _without_latency(settings: RunConfig) -> RunConfig:
    """Settings without camera latency: the simulated transport adds the latency instead."""
    robot = settings.robot
    further = {name: replace(camera, latency_s=0.0) for name, camera in robot.cameras.items()}
    return replace(settings, robot=replace(robot, camera=replace(robot.camera, latency_s=0.0), cameras=further))
