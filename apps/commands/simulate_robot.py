"""`readygo simulate-robot`: a robot to try policies with."""

from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from rich.console import Console

from readygo.apps.cli import Group
from readygo.apps.drive.calibration import info_of
from readygo.apps.drive.robot import Topics
from readygo.apps.drive.simulated import Manners, SimulatedRobot
from readygo.apps.drive.wires import WireName, make_wire
from readygo.apps.run.config import RunConfig
from readygo.apps.run.evaluation import (
    evaluation_config,
    evaluation_world,
    make_evaluator,
    make_request,
)
from readygo.apps.run.origin import avatars_of_policy
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router
from readygo.common.errors import ConfigError
from readygo.common.messages import Outcome, Split
from readygo.common.policy import load_spec
from readygo.common.robot import load_robot
from readygo.services.evaluator import Task


def simulate_robot(
    scene: str,
    policy: Path | None = None,
    /,
    *,
    episodes: int = 1,
    tasks: tuple[Literal["static", "dynamic", "reactive"], ...] = ("static",),
    split: Literal["train", "val", "test"] = "test",
    seed: int = 0,
    robot: Path | None = None,
    config: Path | None = None,
    avatars: Path | None = None,
    latency_s: Annotated[float, Group("manners")] = 0.05,
    jitter_s: Annotated[float, Group("manners")] = 0.01,
    drop_share: Annotated[float, Group("manners")] = 0.02,
    camera_hz: Annotated[float, Group("manners")] = 20.0,
    compressed: Annotated[bool, Group("manners")] = False,
    image: Annotated[str, Group("topics")] = "/camera/image_raw",
    odom: Annotated[str, Group("topics")] = "/odom",
    cmd_vel: Annotated[str, Group("topics")] = "/cmd_vel",
    wire: Annotated[WireName, Group("topics")] = "ros2",
    listen: Annotated[str, Group("topics")] = "tcp/127.0.0.1:7447",
    domain: Annotated[int, Group("topics")] = 0,
) -> None:
    """Be a robot in a scene: send its images and odometry, and do as it is told, in real time.

    The episodes are those of `readygo evaluate SCENE POLICY`. One begins with the first command of `readygo drive
    POLICY --goal-topic /goal_pose --outcome-topic /outcome`, and the next one when nobody commands any more.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        policy: Folder of a trained policy: the robot, people and settings of its data.
        episodes: Episodes per task.
        tasks: What they ask for, as in `readygo evaluate`.
        split: Random streams to draw the episodes from.
        seed: Seed of the episodes.
        robot: robot.toml; its camera may be another one than the policy's.
        config: TOML file with sections of settings.
        avatars: Avatar file or folder of them; those of the policy's data by default, else the embedded ones.
        latency_s: From when an image is taken until it is sent [s].
        jitter_s: Standard deviation of that [s].
        drop_share: Share of images that are lost.
        camera_hz: Images per second: 20, 10, 5, 4, 2 or 1.
        compressed: Send JPEG.
        image: Topic of the images.
        odom: Topic of the Odometry.
        cmd_vel: Topic of the commands.
        wire: As in `readygo drive`.
        listen: Where to open a Zenoh router.
        domain: ROS_DOMAIN_ID.
    """
    console = Console(highlight=False, soft_wrap=True)
    manners = _manners(latency_s, jitter_s, drop_share, camera_hz, compressed)
    spec = load_spec(policy) if policy else None
    own = load_robot(robot) if robot else None
    settings = evaluation_config(spec, "robot" if own else "policy", config=config, robot=own, sensor=None, humans=None)
    settings = _without_latency(settings)
    people = avatars_of_policy(spec) if spec and avatars is None else avatars
    world = evaluation_world(scene, settings, avatars=people, seed=seed)
    evaluator = make_evaluator(world, renderer=world.renderer(), methods={})
    request = make_request(episodes, tasks, ("policy",), Split(split), seed)
    drawn, _ = evaluator.source().draw(seed=seed, split=request.split, count=episodes, tasks=request.tasks)
    eyes, rng = evaluator.eyes(), np.random.default_rng(seed)
    topics = Topics(
        image=image,
        odometry=odom,
        command=cmd_vel,
        camera_info=f"{image.removesuffix('/compressed').rpartition('/')[0]}/camera_info",
        goal="/goal_pose",
        outcome="/outcome",
    )
    found: dict[Task, Counter[Outcome]] = {task: Counter() for task in request.tasks}
    eyes.look([evaluator.simulation(drawn[0])])
    with closing(Router(listen)), closing(ForeignSession(listen)) as session:
        spoken = make_wire(wire, domain=domain, prefix="", stamped=False, node="readygo_robot")
        info = info_of(settings.robot.camera)
        machine = SimulatedRobot(session, spoken, topics, info, lambda one: eyes.look([one])[0], manners, rng)
        console.print(f"a robot waits at {listen}", markup=False)
        for task in request.tasks:
            for episode in drawn:
                if episode.task is not task:
                    continue
                simulation = evaluator.simulation(episode)
                outcome = machine.drive(simulation)
                found[task][outcome] += 1
                name = episode.scenario.episode.episode_id
                console.print(f"{task.value} {name}: {outcome.value} after {simulation.time_s:.2f} s", markup=False)
    for task, outcomes in found.items():
        console.print(f"{task.value}: {outcomes[Outcome.SUCCESS]} of {outcomes.total()} succeed")
    if machine.behind:
        console.print(f"this machine was too slow for real time {machine.behind} times")


def _manners(latency_s: float, jitter_s: float, drop_share: float, camera_hz: float, compressed: bool) -> Manners:
    try:
        return Manners(
            latency_s=latency_s, jitter_s=jitter_s, drop_share=drop_share, camera_hz=camera_hz, compressed=compressed
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _without_latency(settings: RunConfig) -> RunConfig:
    """The way to the policy makes images late here, not the camera."""
    camera = replace(settings.robot.camera, latency_s=0.0)
    return replace(settings, robot=replace(settings.robot, camera=camera))
