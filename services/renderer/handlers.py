"""Render requests, and the samples of whole episodes."""

import dataclasses
import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar, LabelModel, human_labels
from readygo.common.episode.robot import drawn_of_episode, robot_of_episode
from readygo.common.errors import AvatarError, RunError
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.images import FIELDS, Images
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, cameras_of, images_of, kind_of, kinds_of
from readygo.common.messages import (
    Driver,
    EpisodeHeader,
    EpisodeKey,
    EpisodeMotions,
    HumanLabels,
    HumanMotion,
    Humans,
    RenderReply,
    RenderRequest,
    RenderView,
    RobotTrajectory,
    Sample,
    Scenario,
    sample_crc32,
)
from readygo.common.policy.sight import camera_on
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.services.renderer.calibration import calibrations
from readygo.services.renderer.capture import Capture, EpisodeCamera, MomentAt, Shot, pinhole_of
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.drawing import make_drawing
from readygo.services.renderer.encoding import encode_image, encode_outputs
from readygo.services.renderer.sensor.motion import Moment, Timeline
from readygo.services.renderer.sensor.streams import SensorStream

HUMANS_KEPT = 512
"""Keys of people that a renderer remembers."""


class Renderer:
    """One scene with its avatars, ready to be drawn.

    Args:
        scene: The scene bundle.
        avatars: Avatars by name.
        robot: Whose cameras look.
        config: Settings.
    """

    def __init__(self, scene: Scene, avatars: Mapping[str, Avatar], robot: RobotConfig, config: RendererConfig) -> None:
        self.scene, self.robot, self.config = scene, robot, config
        pinholes = {name: pinhole_of(config.sensor, camera) for name, camera in robot.cameras.items()}
        pinhole = pinhole_of(config.sensor, robot.camera)
        self.drawing = make_drawing(scene, avatars, pinhole, config)
        # Gaussians stay with the drawing, which maps them from the scene's cache if it can.
        self.skeletons = {name: avatar.skeleton() for name, avatar in avatars.items()}
        self.label_models = {name: LabelModel.from_avatar(avatar) for name, avatar in avatars.items() if config.labels}
        self.capture = Capture(
            drawing=self.drawing,
            pinhole=pinhole,
            sensor=config.sensor,
            camera=robot.camera,
            sub_frames=config.sub_frames,
            dt_s=robot.clock.dt_s,
        )
        """Takes the pictures of the first camera."""
        self.further = {
            name: dataclasses.replace(
                self.capture,
                drawing=self.drawing if found.draws_like(pinhole) else make_drawing(scene, avatars, found, config),
                pinhole=found,
                camera=robot.cameras[name],
                name=name,
                _cameras=OrderedDict(),
            )
            for name, found in pinholes.items()
        }
        """Take those of the others, by name."""
        self._people: OrderedDict[str, tuple[HumanMotion, ...]] = OrderedDict()

    @property
    def captures(self) -> dict[str, Capture]:
        """What takes the pictures of each camera; the first one is called ""."""
        return {"": self.capture, **self.further}

    def remember(self, people: Humans) -> None:
        """Keep people for later requests.

        Raises:
            AvatarError: If one of them wears an avatar that is not loaded.
        """
        self.check_avatars(people.humans)
        self._people[people.key] = people.humans

    def recall(self, key: str) -> tuple[HumanMotion, ...] | None:
        """People by key: nobody for the empty key, None for an unknown one."""
        if not key:
            return ()
        if key in self._people:
            self._people.move_to_end(key)
        return self._people.get(key)

    def forget_old(self) -> None:
        """Drop the people that were not asked for longest."""
        while len(self._people) > HUMANS_KEPT:
            self._people.popitem(last=False)

    def check_avatars(self, humans: tuple[HumanMotion, ...]) -> None:
        """Raise AvatarError unless every human's avatar is loaded."""
        for human in humans:
            if human.avatar not in self.skeletons:
                raise AvatarError(f"Avatar {human.avatar!r} is not loaded; loaded: {sorted(self.skeletons)}.")


def handle_render(renderer: Renderer, request: RenderRequest) -> RenderReply:
    """Draw the views of a request.

    A view that names its episode and the robot's path is the image that is recorded with that episode. Without a path
    there is neither motion blur nor rolling shutter; without an episode, what a sensor draws per episode it draws per
    key of the people.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
        RunError: If the robot has no such camera.
    """
    for people in request.people:
        renderer.remember(people)
    known = {view.people: renderer.recall(view.people) for view in request.views}
    camera = renderer.robot.camera
    rgb = np.empty((0, camera.height_px, camera.width_px, 3), dtype=np.uint8)
    further: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in request.outputs}
    unknown = tuple(key for key, humans in known.items() if humans is None)
    if not unknown and request.views:
        rgb = np.empty((len(request.views), camera.height_px, camera.width_px, 3), dtype=np.uint8)

        def shots_of(capture: Capture) -> Iterator[Shot]:
            return (_shot(renderer, capture, view, known[view.people] or ()) for view in request.views)

        for number, views in enumerate(robot_views(renderer, shots_of, (RGB, *request.outputs))):
            rgb[number] = views[""].rgb
            for name, found in further.items():
                found.append(view_image(views, name))
    renderer.forget_old()
    outputs = {name: np.stack(found) for name, found in further.items() if found}
    return RenderReply(rgb=rgb, unknown_people=unknown, outputs=outputs)


def robot_views(
    renderer: Renderer, shots_of: Callable[[Capture], Iterable[Shot]], names: Sequence[str]
) -> Iterator[dict[str, Images]]:
    """What the robot's cameras show, one time after the other.

    Args:
        renderer: Scene and cameras.
        shots_of: The shots of a camera at all times.
        names: The images that are wanted, see `readygo.common.images.names`.

    Yields:
        The images of each camera, by its name; the first one is called "".

    Raises:
        RunError: If the robot has no such camera.
    """
    captures, cameras = renderer.captures, cameras_of(names)
    if unknown := [camera for camera in cameras if camera not in captures]:
        raise RunError(f"The robot has no camera {unknown[0]!r}; it has {', '.join(renderer.robot.all_cameras)}.")
    taken = (captures[camera].take(shots_of(captures[camera]), kinds_of(camera, names)) for camera in cameras)
    for views in zip(*taken, strict=True):
        yield dict(zip(cameras, views, strict=True))


def view_image(views: Mapping[str, Images], name: str) -> npt.NDArray[Any]:
    """One of the images that cameras show, by its name."""
    image: npt.NDArray[Any] = getattr(views[camera_of(name)], FIELDS[kind_of(name)])
    return image


def recorded_images(renderer: Renderer) -> tuple[str, ...]:
    """Names of the images that are recorded, of all cameras."""
    return images_of(tuple(renderer.captures), renderer.config.outputs)


def _shot(renderer: Renderer, capture: Capture, view: RenderView, humans: tuple[HumanMotion, ...]) -> Shot:
    if view.episode is None:
        camera = capture.camera_of(SensorStream.of_humans(view.people))
    else:
        camera = episode_camera(renderer, capture, view.episode)
    return Shot(camera=camera, moment_at=_moments(renderer, capture.name, view, humans, camera), step=view.step)


def _moments(
    renderer: Renderer, name: str, view: RenderView, humans: tuple[HumanMotion, ...], camera: EpisodeCamera
) -> MomentAt:
    if not view.path_xyyaw:
        T_world_camera = view.T_world_camera
        if name:
            T_robot_first, T_robot_camera = (
                one.T_world_camera(0.0, 0.0, 0.0, 0.0) for one in (renderer.robot.camera, camera.config)
            )
            T_world_camera = T_world_camera @ np.linalg.inv(T_robot_first) @ T_robot_camera
        moment = Moment(T_world_camera=T_world_camera, humans=humans, step=view.step)
        return lambda _: moment
    timeline = Timeline(
        xyyaw=np.array(view.path_xyyaw),
        humans=humans,
        floor=renderer.scene.maps.floor,
        camera=camera.config,
        first_step=view.step + 1 - len(view.path_xyyaw),
    )
    return timeline.at


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


def episode_camera(renderer: Renderer, capture: Capture, episode: EpisodeKey) -> EpisodeCamera:
    """A camera of an episode's robot, with what its sensor drew."""
    camera = camera_on(robot_of_episode(renderer.robot, episode), capture.name)
    return capture.camera_of(SensorStream.of_episode(episode), camera)


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
    """What is recorded at one time."""

    image: bytes
    """The first camera's encoded rgb."""
    outputs: dict[str, bytes]
    """The further images by name."""


NO_PICTURE = Picture(image=b"", outputs={})
"""Where none was taken."""


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
