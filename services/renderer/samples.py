"""The samples of whole episodes: what is drawn, measured and known at each step."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import human_labels
from readygo.common.episode.robot import drawn_of_episode
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.images import Images
from readygo.common.images.names import GOAL_IMAGE
from readygo.common.messages import (
    Driver,
    EpisodeHeader,
    EpisodeMotions,
    HumanLabels,
    HumanMotion,
    RobotTrajectory,
    Sample,
    Scenario,
    sample_crc32,
)
from readygo.services.renderer.calibration import calibrations
from readygo.services.renderer.capture import Capture, Shot
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.encoding import encode_image, encode_outputs
from readygo.services.renderer.renderer import Renderer, episode_camera, recorded_images, robot_views
from readygo.services.renderer.sensor.motion import Timeline


def episode_header(
    renderer: Renderer, scenario: Scenario, trajectory: RobotTrajectory, driver: Driver = Driver.EXPERT
) -> EpisodeHeader:
    """What is constant over an episode's samples."""
    first, *further = calibrations(renderer.robot, renderer.config.sensor, scenario.episode)
    x_m, y_m, yaw_rad = (float(value) for value in scenario.start_xyyaw)
    return EpisodeHeader(
        episode=scenario.episode,
        sample_count=len(trajectory.xyyaw),
        goal_xy_m=(float(scenario.goal_xy_m[0]), float(scenario.goal_xy_m[1])),
        start_xyyaw=(x_m, y_m, yaw_rad),
        avatars=tuple(human.avatar for human in scenario.humans),
        encounters=tuple(human.encounter for human in scenario.humans),
        image_format=renderer.config.image_format,
        height_px=first.height_px,
        width_px=first.width_px,
        K_px=first.K_px,
        distortion_model=first.distortion_model,
        distortion=first.distortion,
        labels=renderer.config.labels,
        outcome=trajectory.outcome,
        driver=driver,
        image_every=renderer.robot.clock.image_every,
        drawn=drawn_of_episode(renderer.robot, scenario.episode),
        cameras=tuple(further),
    )


def episode_shots(
    renderer: Renderer,
    scenario: Scenario,
    motions: EpisodeMotions,
    trajectory: RobotTrajectory,
    capture: Capture | None = None,
) -> Callable[[int], Shot]:
    """The shot of each step of an episode: what its camera stands before, the first one unless another is given.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    renderer.check_avatars(motions.humans)
    capture = capture or renderer.capture
    camera = episode_camera(renderer, capture, scenario.episode)
    timeline = Timeline(
        xyyaw=trajectory.xyyaw,
        humans=motions.humans,
        floor=renderer.scene.maps.floor,
        camera=camera.config,
    )
    return lambda step: Shot(camera=camera, moment_at=timeline.at, step=step)


def episode_samples(
    renderer: Renderer, scenario: Scenario, motions: EpisodeMotions, trajectory: RobotTrajectory
) -> Iterator[Sample]:
    """Describe every row of a trajectory, one sample each, and draw those at which the camera takes an image.

    Args:
        renderer: Scene, avatars and camera.
        scenario: Goal of the robot.
        motions: How the humans move; after its last row a motion is held.
        trajectory: What the robot did.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    count, every = len(trajectory.xyyaw), renderer.robot.clock.image_every

    def shots_of(capture: Capture) -> Iterator[Shot]:
        return map(episode_shots(renderer, scenario, motions, trajectory, capture), range(0, count, every))

    drawn = robot_views(renderer, shots_of, recorded_images(renderer))
    pictures = (
        encode_picture(next(drawn), renderer.config) if step % every == 0 else NO_PICTURE for step in range(count)
    )
    yield from described_samples(renderer, scenario, motions, trajectory, pictures)


class Picture(NamedTuple):
    """Encoded images that are recorded at one time."""

    image: bytes
    """The first camera's encoded rgb."""
    outputs: dict[str, bytes]
    """The further images by name."""


NO_PICTURE = Picture(image=b"", outputs={})
"""The picture of a sample without images."""


def encode_picture(views: Mapping[str, Images], config: RendererConfig) -> Picture:
    """The files of what the cameras show."""
    outputs: dict[str, bytes] = {}
    for camera, images in views.items():
        outputs |= encode_outputs(images, config, camera)
    return Picture(encode_image(views[""].rgb, config), outputs)


def described_samples(
    renderer: Renderer,
    scenario: Scenario,
    motions: EpisodeMotions,
    trajectory: RobotTrajectory,
    pictures: Iterable[Picture],
) -> Iterator[Sample]:
    """One sample for each row of a trajectory and the picture that was taken there; see `episode_samples`."""
    for step, picture in enumerate(pictures):
        yield _sample(renderer, scenario, motions, trajectory, step, picture)


def _sample(
    renderer: Renderer,
    scenario: Scenario,
    motions: EpisodeMotions,
    trajectory: RobotTrajectory,
    step: int,
    picture: Picture,
) -> Sample:
    x_m, y_m, yaw_rad = (float(value) for value in trajectory.xyyaw[step])
    floor_m = renderer.scene.maps.floor.at(x_m, y_m)
    humans = tuple(_human_xyzyaw(renderer, human, step) for human in motions.humans)
    return Sample(
        seq=step,
        crc32=sample_crc32(picture.image, picture.outputs),
        time_ns=renderer.robot.clock.time_ns(step),
        image=picture.image,
        action_v_mps=float(trajectory.actions[step, 0]),
        action_w_radps=float(trajectory.actions[step, 1]),
        goal_xy_robot_m=goal_in_robot_frame(x_m, y_m, yaw_rad, scenario.goal_xy_m),
        robot_xyzyaw=(x_m, y_m, floor_m, yaw_rad),
        humans_xyzyaw=humans,
        human_distance_m=float(trajectory.human_distance_m[step]),
        time_to_collision_s=float(trajectory.time_to_collision_s[step]),
        human_visible=bool(trajectory.human_visible[step]),
        expert_cost=float(trajectory.expert_cost[step]),
        replanned=bool(trajectory.replanned[step]),
        outputs=picture.outputs,
        labels=_labels(renderer, motions, step, humans),
    )


def with_goal_image(samples: Iterable[Sample], file: bytes) -> Iterator[Sample]:
    """Samples of which the first one has an encoded image of the goal beside its others."""
    for sample in samples:
        if sample.seq == 0:
            outputs = {**sample.outputs, GOAL_IMAGE: file}
            yield dataclasses.replace(sample, outputs=outputs, crc32=sample_crc32(sample.image, outputs))
        else:
            yield sample


def _labels(
    renderer: Renderer, motions: EpisodeMotions, step: int, humans: Sequence[tuple[float, float, float, float]]
) -> tuple[HumanLabels, ...]:
    if not renderer.config.labels:
        return ()
    return tuple(
        human_labels(renderer.label_models[human.avatar], human.motion, step, yaw_rad)
        for human, (_, _, _, yaw_rad) in zip(motions.humans, humans, strict=True)
    )


def _human_xyzyaw(renderer: Renderer, human: HumanMotion, step: int) -> tuple[float, float, float, float]:
    row = human.motion.row(step)
    x_m, y_m = float(human.motion.root_m[row, 0]), float(human.motion.root_m[row, 1])
    return x_m, y_m, renderer.scene.maps.floor.at(x_m, y_m), facing_yaw(human.motion.pose_axis_angle[row, 0])


def facing_yaw(orientation_axis_angle: npt.NDArray[np.float32]) -> float:
    """Heading in the z-up world [rad] of a body whose global orientation, SMPL y-up, is an axis-angle vector [rad].

    The body faces SMPL's +z, which Rodrigues' formula turns; (x, y, z)_zup = (x, -z, y)_yup.
    """
    a, b, c = (float(value) for value in orientation_axis_angle)
    angle = math.sqrt(a * a + b * b + c * c)
    if angle < 1e-9:
        return math.atan2(-1.0, 0.0)
    a, b, c = a / angle, b / angle, c / angle
    x = math.sin(angle) * b + (1.0 - math.cos(angle)) * a * c
    z = math.cos(angle) + (1.0 - math.cos(angle)) * c * c
    return math.atan2(-z, x)
