"""Render requests."""

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array
from readygo.common.images.names import RGB
from readygo.common.messages import HumanMotion, RenderReply, RenderRequest, RenderView
from readygo.services.renderer.camera import EpisodeCamera, Shot, path_poses
from readygo.services.renderer.renderer import Renderer, view_image


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
    unknown = tuple(key for key, humans in known.items() if humans is None)
    shots = [] if unknown else [_shot(renderer, view, known[view.people] or ()) for view in request.views]
    camera = renderer.robot.camera
    rgb = np.empty((len(shots), camera.height_px, camera.width_px, 3), dtype=np.uint8)
    further: dict[str, list[AnyArray]] = {name: [] for name in request.outputs}
    for number, views in enumerate(renderer.render(shots, (RGB, *further))):
        rgb[number] = views[""].rgb
        for name, images in further.items():
            images.append(view_image(views, name))
    renderer.forget_old()
    outputs = {name: np.stack(images) for name, images in further.items() if images}
    return RenderReply(rgb=rgb, unknown_people=unknown, outputs=outputs)


def _shot(renderer: Renderer, view: RenderView, humans: tuple[HumanMotion, ...]) -> Shot:
    if view.path_xyyaw:
        first_step = view.step + 1 - len(view.path_xyyaw)
        pose_at = path_poses(np.array(view.path_xyyaw), renderer.scene.maps.floor, first_step)
    else:

        def pose_at(camera: EpisodeCamera, step: float) -> Float64Array:
            if not camera.name:
                return view.T_world_camera
            T_robot_first, T_robot_camera = (
                mounted.T_world_camera(0.0, 0.0, 0.0, 0.0) for mounted in (renderer.robot.camera, camera.config)
            )
            T_world_robot: Float64Array = view.T_world_camera @ np.linalg.inv(T_robot_first)
            return T_world_robot @ T_robot_camera

    episode = view.people if view.episode is None else view.episode
    return Shot(step=view.step, pose_at=pose_at, humans=humans, episode=episode, still=not view.path_xyyaw)
