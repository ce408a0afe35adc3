"""The pictures of an episode while it is driven."""

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.common.policy.sight import RGB, camera_sight
from readygo.services.renderer.capture import Shot
from readygo.services.renderer.handlers import Picture, Renderer, encode_picture, episode_camera
from readygo.services.renderer.sensor.motion import Timeline


class LiveCamera:
    """Takes the pictures of one episode step by step: those that `episode_samples` draws of the finished trajectory."""

    def __init__(self, renderer: Renderer, simulation: EpisodeSimulation, sees: tuple[str, ...] = (RGB,)) -> None:
        """Put the camera onto the robot.

        Args:
            renderer: Scene, avatars and camera.
            simulation: The episode at its start.
            sees: Images that who drives sees, see `readygo.common.policy.sight`.

        Raises:
            AvatarError: If a human wears an avatar that is not loaded.
        """
        renderer.check_avatars(simulation.motions.humans)
        self._renderer, self._simulation, self._sees = renderer, simulation, sees
        self._outputs = tuple(dict.fromkeys((*renderer.config.outputs, *sees)))
        self._camera = episode_camera(renderer, simulation.scenario)
        self.pictures: dict[int, Picture] = {}
        """What was taken so far, as it is recorded, by step."""

    def take(self) -> npt.NDArray[np.uint8]:
        """What who drives sees at the simulation's present step, shape (H, W, C); at most once at a step."""
        renderer, step = self._renderer, self._simulation.step
        timeline = Timeline(
            xyyaw=self._simulation.path_xyyaw(0, step),
            humans=self._simulation.motions.humans,
            floor=renderer.scene.maps.floor,
            camera=renderer.robot.camera,
        )
        shot = Shot(camera=self._camera, moment_at=timeline.at, step=step)
        (images,) = renderer.capture.take((shot,), self._outputs)
        self.pictures[step] = encode_picture(images, renderer.config)
        name, camera = self._simulation.scenario.episode.episode_id, renderer.robot.camera
        return camera_sight(images.rgb, images.depth_m, self._sees, camera, name, step)
