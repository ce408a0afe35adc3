"""Render requests, and the samples of whole episodes."""

import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar, LabelModel, human_labels
from readygo.common.errors import AvatarError
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.images import FIELDS, Images
from readygo.common.messages import (
    Driver,
    EpisodeHeader,
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
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import STEP_NS
from readygo.common.scenes import Scene
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
        robot: Whose camera looks.
        config: Settings.
    """

    def __init__(self, scene: Scene, avatars: Mapping[str, Avatar], robot: RobotConfig, config: RendererConfig) -> None:
        self.scene, self.robot, self.config = scene, robot, config
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
        )
        self._people: OrderedDict[str, tuple[HumanMotion, ...]] = OrderedDict()

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
    """
    for people in request.people:
        renderer.remember(people)
    known = {view.people: renderer.recall(view.people) for view in request.views}
    camera = renderer.robot.camera
    rgb = np.empty((0, camera.height_px, camera.width_px, 3), dtype=np.uint8)
    further: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in request.outputs}
    unknown = tuple(key for key, humans in known.items() if humans is None)
    if not unknown and request.views:
        shots = (_shot(renderer, view, known[view.people] or ()) for view in request.views)
        rgb = np.empty((len(request.views), camera.height_px, camera.width_px, 3), dtype=np.uint8)
        for number, images in enumerate(renderer.capture.take(shots, ("rgb", *request.outputs))):
            rgb[number] = images.rgb
            for name, found in further.items():
                found.append(getattr(images, FIELDS[name]))
    renderer.forget_old()
    outputs = {name: np.stack(found) for name, found in further.items() if found}
    return RenderReply(rgb=rgb, unknown_people=unknown, outputs=outputs)


def _shot(renderer: Renderer, view: RenderView, humans: tuple[HumanMotion, ...]) -> Shot:
    episode = SensorStream.of_humans(view.people) if view.episode is None else SensorStream.of_episode(view.episode)
    camera = renderer.capture.camera_of(episode)
    return Shot(camera=camera, moment_at=_moments(renderer, view, humans), step=view.step)


def _moments(renderer: Renderer, view: RenderView, humans: tuple[HumanMotion, ...]) -> MomentAt:
    if not view.path_xyyaw:
        moment = Moment(T_world_camera=view.T_world_camera, humans=humans, step=view.step)
        return lambda _: moment
    timeline = Timeline(
        xyyaw=np.array(view.path_xyyaw),
        humans=humans,
        floor=renderer.scene.maps.floor,
        camera=renderer.robot.camera,
        first_step=view.step + 1 - len(view.path_xyyaw),
    )
    return timeline.at


def episode_header(
    renderer: Renderer, scenario: Scenario, trajectory: RobotTrajectory, driver: Driver = Driver.EXPERT
) -> EpisodeHeader:
    """What is constant over an episode's samples."""
    camera = episode_camera(renderer, scenario)
    lens = camera.lens
    x_m, y_m, yaw_rad = (float(value) for value in scenario.start_xyyaw)
    return EpisodeHeader(
        episode=scenario.episode,
        sample_count=len(trajectory.xyyaw),
        goal_xy_m=(float(scenario.goal_xy_m[0]), float(scenario.goal_xy_m[1])),
        start_xyyaw=(x_m, y_m, yaw_rad),
        avatars=tuple(human.avatar for human in scenario.humans),
        encounters=tuple(human.encounter for human in scenario.humans),
        image_format=renderer.config.image_format,
        height_px=lens.height_px,
        width_px=lens.width_px,
        K_px=tuple(float(value) for value in lens.K_px.ravel()),
        distortion_model=camera.distortion_model,
        distortion=lens.coefficients,
        labels=renderer.config.labels,
        outcome=trajectory.outcome,
        driver=driver,
    )


def episode_camera(renderer: Renderer, scenario: Scenario) -> EpisodeCamera:
    """The camera of an episode, with what its sensor drew."""
    return renderer.capture.camera_of(SensorStream.of_episode(scenario.episode))


def episode_shots(
    renderer: Renderer, scenario: Scenario, motions: EpisodeMotions, trajectory: RobotTrajectory
) -> Callable[[int], Shot]:
    """The shot of each step of an episode: what its camera stands before.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    renderer.check_avatars(motions.humans)
    camera = episode_camera(renderer, scenario)
    timeline = Timeline(
        xyyaw=trajectory.xyyaw,
        humans=motions.humans,
        floor=renderer.scene.maps.floor,
        camera=renderer.robot.camera,
    )
    return lambda step: Shot(camera=camera, moment_at=timeline.at, step=step)


def episode_samples(
    renderer: Renderer, scenario: Scenario, motions: EpisodeMotions, trajectory: RobotTrajectory
) -> Iterator[Sample]:
    """Draw and describe every row of a trajectory, one sample each.

    Args:
        renderer: Scene, avatars and camera.
        scenario: Goal of the robot.
        motions: How the humans move; after its last row a motion is held.
        trajectory: What the robot did.

    Raises:
        AvatarError: If a human wears an avatar that is not loaded.
    """
    shot_at = episode_shots(renderer, scenario, motions, trajectory)
    drawn = renderer.capture.take(map(shot_at, range(len(trajectory.xyyaw))), renderer.config.outputs)
    pictures = (encode_picture(images, renderer.config) for images in drawn)
    yield from described_samples(renderer, scenario, motions, trajectory, pictures)


class Picture(NamedTuple):
    """What is recorded of one view."""

    image: bytes
    """The encoded rgb."""
    outputs: dict[str, bytes]
    """The further images by name."""


NO_PICTURE = Picture(image=b"", outputs={})
"""Where none was taken."""


def encode_picture(images: Images, config: RendererConfig) -> Picture:
    """The files of a view's images."""
    return Picture(encode_image(images.rgb, config), encode_outputs(images, config))


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
        time_ns=step * STEP_NS,
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
