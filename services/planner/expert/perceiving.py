"""Perceive, track, plan: the expert drives on the map that it knows, among the people that the robot's camera shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.perception import Perceived, Perception
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.perception.simulated import SimulatedPerception
from readygo.common.policy.driver import PolicyCamera
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.perception import Pose
from readygo.services.planner.expert.spacetime import SpaceTimeExpert
from readygo.services.planner.expert.tracked import TrackedHumans

LOOK_S = 0.1
"""Time between two looks, as near as images come to it [s]."""


class EpisodePerception:
    """Perception over one episode: the latest images, the robot's own motion, and the tracks of people."""

    def __init__(self, perception: Perception, people: TrackedHumans, robot: RobotConfig) -> None:
        """Begin an episode.

        Args:
            perception: Tells what images show.
            people: The tracks.
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
        return step % max(1, self._clock.steps(LOOK_S)) == 0 or self._clock.image_every > 1

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
        self.people.look(step, pose, self.perceived.people)


@dataclass(eq=False)
class PerceivingState:
    """What the driver remembers of one episode."""

    perception: EpisodePerception
    expert: SpaceTimeExpert


OnLook = Callable[[EpisodeSimulation, EpisodePerception, UInt8Array], None]
"""Called after a look: the episode, what was perceived, the image."""


class PerceivingDriver:
    """Drives by images, odometry, map and goal. It knows nothing else of people."""

    looks = True
    on_look: OnLook | None = None
    """Told of every look, for viewers."""

    def __init__(
        self,
        perception: Perception,
        camera: PolicyCamera,
        make_expert: Callable[[EpisodeSimulation], tuple[SpaceTimeExpert, TrackedHumans]],
    ) -> None:
        """Prepare to drive.

        Args:
            perception: Tells what images show.
            camera: Where its images come from.
            make_expert: Makes the expert of an episode, and the tracks that it knows people by.
        """
        self._perception, self._camera, self._make_expert = perception, camera, make_expert

    def start(self, simulation: EpisodeSimulation) -> PerceivingState:
        """See `Driver.start`."""
        expert, people = self._make_expert(simulation)
        return PerceivingState(EpisodePerception(self._perception, people, simulation.robot), expert)

    def act(self, running: Sequence[tuple[EpisodeSimulation, PerceivingState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        for simulation, state in running:
            state.perception.advance((simulation.v_mps, simulation.w_radps))
        looking = [
            (simulation, state)
            for simulation, state in running
            if self._camera.arrives(simulation) and state.perception.is_due(simulation.step)
        ]
        if looking:
            images = self._camera.look([simulation for simulation, _ in looking])
            for (simulation, state), image in zip(looking, images, strict=True):
                self._look(simulation, state, image)
        decisions = [state.expert.act(simulation) for simulation, state in running]
        return [(decision.v_mps, decision.w_radps) for decision in decisions]

    def _look(self, simulation: EpisodeSimulation, state: PerceivingState, image: UInt8Array) -> None:
        perception, step = state.perception, simulation.step
        taken = perception.taken_at(step)
        x, y, yaw = simulation.path_xyyaw(taken, taken)[0].tolist()
        perception.look(step, image, (simulation.v_mps, simulation.w_radps), (x, y, yaw))
        if self.on_look is not None:
            self.on_look(simulation, perception, image)


class TrackedDriver:
    """The expert with a student's eyes: people are tracked from what a network would tell of those in view."""

    looks = False

    def __init__(
        self,
        noise: PerceptionNoise,
        make_expert: Callable[[EpisodeSimulation], tuple[SpaceTimeExpert, TrackedHumans]],
    ) -> None:
        """Prepare to drive.

        Args:
            noise: How perception errs.
            make_expert: As for `PerceivingDriver`.
        """
        self._noise, self._make_expert = noise, make_expert

    def start(self, simulation: EpisodeSimulation) -> tuple[SpaceTimeExpert, TrackedHumans, SimulatedPerception]:
        """See `Driver.start`."""
        rng = episode_rng(simulation.scenario.episode, Purpose.PERCEPTION)
        return *self._make_expert(simulation), SimulatedPerception(self._noise, simulation.robot.camera, rng)

    def act(
        self, running: Sequence[tuple[EpisodeSimulation, tuple[SpaceTimeExpert, TrackedHumans, SimulatedPerception]]]
    ) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        commands: list[Command | DriverFailure] = []
        for simulation, (expert, people, perception) in running:
            if simulation.step % max(1, simulation.clock.steps(1.0 / self._noise.rate_hz)) == 0:
                self._look(simulation, people, perception)
            decision = expert.act(simulation)
            commands.append((decision.v_mps, decision.w_radps))
        return commands

    def _look(self, simulation: EpisodeSimulation, people: TrackedHumans, perception: SimulatedPerception) -> None:
        step, pose = simulation.step, (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        here, before = simulation.human_xy_m, simulation.human_xy_at(max(step - 2, 0))
        velocity = (here - before) / (max(min(step, 2), 1) * simulation.clock.dt_s)
        visible = np.array([people.eyes.show(pose, x, y) for x, y in here.tolist()], np.bool_)
        people.look(step, pose, perception.look(simulation.time_s, pose, here, velocity, visible))
