"""A scene with its avatars and a robot's cameras, ready to be drawn."""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy.typing as npt

from readygo.common.avatars import Avatar, LabelModel
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import AvatarError, RunError
from readygo.common.images.images import FIELDS, Images
from readygo.common.images.names import camera_of, cameras_of, images_of, kind_of, kinds_of
from readygo.common.messages import (
    EpisodeKey,
    HumanMotion,
    Humans,
)
from readygo.common.policy.sight import camera_on
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.services.renderer.capture import Capture, EpisodeCamera, Shot, pinhole_of
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.drawing import make_drawing
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
        """People by key: an empty tuple for the empty key, None for an unknown key."""
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


def episode_camera(renderer: Renderer, capture: Capture, episode: EpisodeKey) -> EpisodeCamera:
    """A camera of an episode's robot, with what its sensor drew."""
    camera = camera_on(robot_of_episode(renderer.robot, episode), capture.name)
    return capture.camera_of(SensorStream.of_episode(episode), camera)


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
    config, taken = renderer.config, []
    for camera in cameras:
        images = captures[camera].take(shots_of(captures[camera]), config.rasterized(kinds_of(camera, names)))
        taken.append(map(partial(_with_depth, config), images))
    for views in zip(*taken, strict=True):
        yield dict(zip(cameras, views, strict=True))


def _with_depth(config: RendererConfig, images: Images) -> Images:
    """The images with the depth that the settings ask for as their depth, where there is one."""
    return dataclasses.replace(images, depth_m=images.median_depth_m) if config.depth == "median" else images


def view_image(views: Mapping[str, Images], name: str) -> npt.NDArray[Any]:
    """One of the images that cameras show, by its name."""
    image: npt.NDArray[Any] = getattr(views[camera_of(name)], FIELDS[kind_of(name)])
    return image


def recorded_images(renderer: Renderer) -> tuple[str, ...]:
    """Names of the images that are recorded, of all cameras."""
    return images_of(tuple(renderer.captures), renderer.config.outputs)
