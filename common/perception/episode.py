"""Perception over one simulated episode: the one way from images to tracks, for every driver that perceives."""

from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command
from readygo.common.perception.people import People
from readygo.common.perception.perception import Perceived, Perception
from readygo.common.perception.tracker import PeopleTracker, Pose
from readygo.common.policy.driver import PolicyCamera
from readygo.common.robot import RobotConfig

LOOK_S = 0.1
"""Time between two looks, as near as images come to it [s]."""


class TakesLooks(Protocol):
    """What an image told of people is for it."""

    @property
    def tracker(self) -> PeopleTracker:
        """The people over time."""
        ...

    def look(self, step: int, pose: Pose, people: People) -> None:
        """Fuse what an image told.

        Args:
            step: The step at which the image was taken; later ones may have passed.
            pose: The robot at that step: x, y [m], yaw [rad].
            people: What was perceived, in the robot's frame.
        """
        ...


class SteppedTracker:
    """A tracker that follows an episode's steps."""

    def __init__(self, tracker: PeopleTracker, dt_s: float, shows: Callable[[Pose, float, float], bool]) -> None:
        """Begin an episode.

        Args:
            tracker: The tracker.
            dt_s: Length of a step [s].
            shows: True if a robot's camera shows a human at a place of the world [m], as far as the map says.
        """
        self.tracker = tracker
        """The people over time."""
        self._dt_s, self._shows, self._step = dt_s, shows, 0

    def advance(self, step: int) -> None:
        """Bring the tracks to a step."""
        for _ in range(self._step, step):
            self.tracker.predict(self._dt_s)
        self._step = max(self._step, step)

    def look(self, step: int, pose: Pose, people: People) -> None:
        """See `TakesLooks`."""
        self.advance(step)
        late_s = (self._step - step) * self._dt_s
        self.tracker.fuse(pose, people, lambda x, y: self._shows(pose, x, y), late_s=late_s)


Sink = TypeVar("Sink", bound=TakesLooks, covariant=True)


class EpisodePerception(Generic[Sink]):
    """Perception over one episode: the latest images, the robot's own motion, and who takes what is perceived."""

    def __init__(self, perception: Perception, people: Sink, robot: RobotConfig) -> None:
        """Begin an episode.

        Args:
            perception: Tells what images show.
            people: Takes it.
            robot: Of the episode.
        """
        self.people = people
        self._perception, self._memory, self._clock = perception, perception.start(), robot.clock
        self._late_steps = robot.clock.steps(robot.camera.latency_s)
        self.perceived: Perceived | None = None
        """What the latest look told."""
        self.pose: Pose = (0.0, 0.0, 0.0)
        """The robot when the latest image was taken: x, y [m], yaw [rad]."""

    def advance(self, command: Command) -> None:
        """Let a step pass, over which v [m/s], w [rad/s] were executed; the first call is the episode's begin."""
        self._memory.advance(np.array(command, np.float32))

    def arrives(self, step: int) -> bool:
        """True if an image comes at a step."""
        return self._clock.sees(step, self._late_steps)

    def is_due(self, step: int) -> bool:
        """True if the image that comes at a step is looked at."""
        return step == 0 or (step - self._late_steps) % self._clock.nearest_images(LOOK_S) == 0

    def taken_at(self, step: int) -> int:
        """The step at which the image was taken that comes at a step."""
        return self._clock.image_step(step, self._late_steps)

    def look(self, step: int, image: UInt8Array, command: Command, pose: Pose) -> None:
        """Perceive.

        Args:
            step: The present step.
            image: What the camera shows, sRGB, shape (H, W, 3).
            command: Executed last.
            pose: The robot when the image was taken.
        """
        self._memory.see(image)
        self.perceived = self._perception.perceive(self._memory, np.array(command, np.float32))
        self.pose = pose
        self.people.look(self.taken_at(step), pose, self.perceived.people)


OnLook = Callable[[EpisodeSimulation, EpisodePerception[Sink], UInt8Array], None]
"""Called after a look: the episode, what was perceived, the image."""


def perceive_step(
    camera: PolicyCamera, running: Sequence[tuple[EpisodeSimulation, EpisodePerception[Sink]]]
) -> list[tuple[EpisodeSimulation, EpisodePerception[Sink], UInt8Array]]:
    """Let a step of several episodes pass, and perceive the images that are due; their views share a request.

    Args:
        camera: Where images come from.
        running: Episodes with their perception.

    Returns:
        The episodes in which an image was looked at, and these images.
    """
    for simulation, perception in running:
        perception.advance((simulation.v_mps, simulation.w_radps))
    looking = [
        (simulation, perception)
        for simulation, perception in running
        if camera.arrives(simulation) and perception.is_due(simulation.step)
    ]
    images = camera.look([simulation for simulation, _ in looking]) if looking else ()
    looked = []
    for (simulation, perception), image in zip(looking, images, strict=True):
        taken = perception.taken_at(simulation.step)
        x, y, yaw = simulation.path_xyyaw(taken, taken)[0].tolist()
        perception.look(simulation.step, image, (simulation.v_mps, simulation.w_radps), (x, y, yaw))
        looked.append((simulation, perception, image))
    return looked
