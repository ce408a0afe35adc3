"""The pictures of an episode while it is driven."""

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.common.images.names import RGB
from readygo.common.policy.sight import robot_sight
from readygo.services.renderer.capture import Capture, Shot
from readygo.services.renderer.renderer import Renderer, episode_camera, recorded_images, robot_views, view_image
from readygo.services.renderer.samples import Picture, encode_picture
from readygo.services.renderer.sensor.motion import Timeline


class LiveCamera:
    """Takes the pictures of one episode step by step: those that `episode_samples` draws of the finished trajectory."""

    def __init__(self, renderer: Renderer, simulation: EpisodeSimulation, sees: tuple[str, ...] = (RGB,)) -> None:
        """Put the cameras onto the robot.

        Args:
            renderer: Scene, avatars and cameras.
            simulation: The episode at its start.
            sees: Images that who drives sees, see `readygo.common.policy.sight`.

        Raises:
            AvatarError: If a human wears an avatar that is not loaded.
        """
        renderer.check_avatars(simulation.motions.humans)
        self._renderer, self._simulation, self._sees = renderer, simulation, sees
        self._names = tuple(dict.fromkeys((*recorded_images(renderer), *sees)))
        self.pictures: dict[int, Picture] = {}
        """What was taken so far, as it is recorded, by step."""

    def take(self) -> npt.NDArray[np.uint8]:
        """What who drives sees at the simulation's present step, shape (H, W, C); at most once at a step."""
        renderer, step = self._renderer, self._simulation.step
        (views,) = robot_views(renderer, self._shots, self._names)
        self.pictures[step] = encode_picture(views, renderer.config)
        drawn = {name: view_image(views, name) for name in self._sees}
        return robot_sight(drawn, self._sees, renderer.robot, self._simulation.scenario.episode.episode_id, step)

    def _shots(self, capture: Capture) -> tuple[Shot, ...]:
        simulation = self._simulation
        camera = episode_camera(self._renderer, capture, simulation.scenario.episode)
        timeline = Timeline(
            xyyaw=simulation.path_xyyaw(0, simulation.step),
            humans=simulation.motions.humans,
            floor=self._renderer.scene.maps.floor,
            camera=camera.config,
        )
        return (Shot(camera=camera, moment_at=timeline.at, step=simulation.step),)
