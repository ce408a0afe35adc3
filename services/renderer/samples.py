"""The samples of whole episodes: what is drawn, encoded, measured and known at each step."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.avatars import human_labels
from readygo.common.episode.robot import drawn_of_episode
from readygo.common.errors import RunError
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.files import encode_output
from readygo.common.images.images import Images
from readygo.common.images.names import GOAL_IMAGE, RGB, image_name
from readygo.common.messages import (
    DriverKind,
    EpisodeHeader,
    EpisodeKey,
    EpisodeMotions,
    HumanMotion,
    RobotTrajectory,
    Sample,
    Scenario,
    sample_crc32,
)
from readygo.services.renderer.camera import Shot, calibrations, path_poses
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.renderer import Renderer


class Picture(NamedTuple):
    """Encoded images that are recorded at one time."""

    image: bytes
    """The first camera's encoded rgb."""
    outputs: dict[str, bytes]
    """The further images by name."""


NO_PICTURE = Picture(image=b"", outputs={})
"""The picture of a sample without images."""


def episode_header(
    renderer: Renderer, scenario: Scenario, trajectory: RobotTrajectory, driver: DriverKind = DriverKind.EXPERT
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
    episode: EpisodeKey,
    motions: EpisodeMotions,
    xyyaw: Float64Array,
    steps: Iterable[int],
) -> list[Shot]:
    """Shots of an episode, as they are recorded.

    Args:
        renderer: Scene, avatars and cameras.
        episode: The episode.
        motions: How the humans move; after its last row a motion is held.
        xyyaw: The robot at each step from the first one on: x, y [m], yaw [rad], shape (T, 3).
        steps: Steps of the shots.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    renderer.check_avatars(motions.humans)
    pose_at = path_poses(xyyaw, renderer.scene.maps.floor)
    return [Shot(step=step, pose_at=pose_at, humans=motions.humans, episode=episode) for step in steps]


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
    shots = episode_shots(renderer, scenario.episode, motions, trajectory.xyyaw, range(0, count, every))
    drawn = renderer.render(shots, renderer.recorded_images)
    pictures = (
        encode_picture(next(drawn), renderer.config) if step % every == 0 else NO_PICTURE for step in range(count)
    )
    yield from described_samples(renderer, scenario, motions, trajectory, pictures)


def described_samples(
    renderer: Renderer,
    scenario: Scenario,
    motions: EpisodeMotions,
    trajectory: RobotTrajectory,
    pictures: Iterable[Picture],
) -> Iterator[Sample]:
    """One sample for each row of a trajectory and the picture that was taken there; see `episode_samples`."""
    floor = renderer.scene.maps.floor
    for step, picture in enumerate(pictures):
        x_m, y_m, yaw_rad = (float(value) for value in trajectory.xyyaw[step])
        humans = tuple(_human_xyzyaw(renderer, human, step) for human in motions.humans)
        labels = tuple(
            human_labels(renderer.label_models[human.avatar], human.motion, step, facing_rad)
            for human, (_, _, _, facing_rad) in zip(motions.humans, humans, strict=True)
            if renderer.config.labels
        )
        yield Sample(
            seq=step,
            crc32=sample_crc32(picture.image, picture.outputs),
            time_ns=renderer.robot.clock.time_ns(step),
            image=picture.image,
            action_v_mps=float(trajectory.actions[step, 0]),
            action_w_radps=float(trajectory.actions[step, 1]),
            goal_xy_robot_m=goal_in_robot_frame(x_m, y_m, yaw_rad, scenario.goal_xy_m),
            robot_xyzyaw=(x_m, y_m, floor.at(x_m, y_m), yaw_rad),
            humans_xyzyaw=humans,
            human_distance_m=float(trajectory.human_distance_m[step]),
            time_to_collision_s=float(trajectory.time_to_collision_s[step]),
            human_visible=bool(trajectory.human_visible[step]),
            expert_cost=float(trajectory.expert_cost[step]),
            replanned=bool(trajectory.replanned[step]),
            outputs=picture.outputs,
            labels=labels,
        )


def with_goal_image(samples: Iterable[Sample], file: bytes) -> Iterator[Sample]:
    """Samples of which the first one has an encoded image of the goal beside its others."""
    for sample in samples:
        if sample.seq == 0:
            outputs = {**sample.outputs, GOAL_IMAGE: file}
            yield dataclasses.replace(sample, outputs=outputs, crc32=sample_crc32(sample.image, outputs))
        else:
            yield sample


def encode_picture(views: Mapping[str, Images], config: RendererConfig) -> Picture:
    """The files of what the cameras show, as `readygo.common.images.files` describes them.

    Args:
        views: Images of each camera, by its name.
        config: Which images are recorded; of cameras besides the first one the rgb is among the outputs.

    Raises:
        RunError: If a view lacks one of them.
    """
    outputs: dict[str, bytes] = {}
    for camera, images in views.items():
        if camera:
            outputs[image_name(camera, RGB)] = encode_image(images.rgb, config)
        try:
            outputs |= {image_name(camera, name): encode_output(images, name) for name in config.outputs if name != RGB}
        except ValueError as error:
            raise RunError(f"The {config.backend} backend cannot do that: {error}") from error
    return Picture(encode_image(views[""].rgb, config), outputs)


def encode_image(rgb: UInt8Array, config: RendererConfig) -> bytes:
    """An sRGB image, shape (H, W, 3), as a JPEG or PNG file."""
    import cv2

    bgr = np.ascontiguousarray(rgb[..., ::-1])
    if config.image_format == "jpeg":
        done, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality])
    else:
        done, encoded = cv2.imencode(".png", bgr)
    assert done
    return bytes(encoded)


def _human_xyzyaw(renderer: Renderer, human: HumanMotion, step: int) -> tuple[float, float, float, float]:
    row = human.motion.row(step)
    x_m, y_m = float(human.motion.root_m[row, 0]), float(human.motion.root_m[row, 1])
    return x_m, y_m, renderer.scene.maps.floor.at(x_m, y_m), facing_yaw(human.motion.pose_axis_angle[row, 0])


def facing_yaw(orientation_axis_angle: Float32Array) -> float:
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
