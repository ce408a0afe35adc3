"""Render requests."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.images.names import RGB
from readygo.common.messages import (
    HumanMotion,
    RenderReply,
    RenderRequest,
    RenderView,
)
from readygo.services.renderer.capture import Capture, EpisodeCamera, MomentAt, Shot
from readygo.services.renderer.renderer import Renderer, episode_camera, robot_views, view_image
from readygo.services.renderer.sensor.motion import Moment, Timeline
from readygo.services.renderer.sensor.streams import SensorStream


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
