"""The images of an episode while it is driven."""

from collections import deque
from collections.abc import Sequence

from readygo.common.arrays import UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.goal import goal_pose
from readygo.common.episode.loop import Observer
from readygo.common.images.names import RGB
from readygo.common.policy.sight import robot_sight
from readygo.services.renderer.looks import goal_view
from readygo.services.renderer.renderer import Renderer, view_image
from readygo.services.renderer.samples import Picture, encode_picture, episode_shots


class LiveCamera(Observer):
    """Takes the images of one episode step by step: those that `episode_samples` draws of the finished trajectory.

    It is a `readygo.common.policy.driver.PolicyCamera`: a driver gets each image the robot's camera latency later.
    """

    def __init__(self, renderer: Renderer, sees: tuple[str, ...] = (RGB,), image_every: int | None = None) -> None:
        """Prepare for one episode.

        Args:
            renderer: Scene, avatars and cameras.
            sees: Images that the driver sees, see `readygo.common.policy.sight`.
            image_every: Steps from image to image; those of the robot's camera by default.
        """
        self._renderer, self._sees = renderer, sees
        self._names = tuple(dict.fromkeys((*renderer.recorded_images, *sees)))
        clock = renderer.robot.clock
        self.image_every = clock.image_every if image_every is None else image_every
        """Steps from image to image."""
        self.pictures: dict[int, Picture] = {}
        """What was taken so far, as it is recorded, by step."""
        self._late_steps = 0
        self._waiting: deque[tuple[int, UInt8Array]] = deque()

    def begin(self, simulation: EpisodeSimulation) -> None:
        """Put the cameras onto the robot.

        Raises:
            AvatarError: If a human wears an avatar that is not loaded.
        """
        self._renderer.check_avatars(simulation.motions.humans)
        self._late_steps = simulation.clock.steps(simulation.robot.camera.latency_s)

    def step(self, simulation: EpisodeSimulation) -> None:
        """Take an image if one is due."""
        step = simulation.step
        if step % self.image_every:
            return
        episode, path = simulation.scenario.episode, simulation.path_xyyaw(0, step)
        shots = episode_shots(self._renderer, episode, simulation.motions, path, [step])
        (views,) = self._renderer.render(shots, self._names)
        self.pictures[step] = encode_picture(views, self._renderer.config)
        drawn = {name: view_image(views, name) for name in self._sees}
        sight = robot_sight(drawn, self._sees, self._renderer.robot, episode.episode_id, step)
        self._waiting.append((step, sight))
        self._drop_older(step)

    def arrives(self, simulation: EpisodeSimulation) -> bool:
        """True if an image reaches the driver at the present step: the first one does until there is another."""
        return simulation.step == 0 or (simulation.step - self._late_steps) % self.image_every == 0

    def look(self, simulations: Sequence[EpisodeSimulation]) -> UInt8Array:
        """The image that reaches the driver of the one episode at the present step, shape (1, H, W, C)."""
        (simulation,) = simulations
        self._drop_older(simulation.step)
        return self._waiting[0][1][None]

    def goal_image(self, simulation: EpisodeSimulation) -> UInt8Array:
        """What the robot would see at its goal without humans, sRGB, shape (H, W, 3)."""
        pose = goal_pose(simulation.scenario, simulation.robot_map, simulation.robot.planning_radius_m)
        return goal_view(self._renderer, simulation.scenario.episode, pose)

    def _drop_older(self, step: int) -> None:
        """Forget the images before the one that has reached the driver by a step."""
        while len(self._waiting) > 1 and self._waiting[1][0] <= step - self._late_steps:
            self._waiting.popleft()
