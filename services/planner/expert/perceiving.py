"""Perceive, track, plan: the expert drives on the map that it knows, among the people that the robot's camera shows."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages import EpisodeKey
from readygo.common.perception import Perception
from readygo.common.perception.episode import EpisodePerception, OnLook, perceive_step
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.perception.simulated import SimulatedPerception
from readygo.common.policy.driver import PolicyCamera
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.interface import Decision
from readygo.services.planner.expert.spacetime import SpaceTimeExpert
from readygo.services.planner.expert.tracked import TrackedHumans


@dataclass(eq=False)
class PerceivingState:
    """What the driver remembers of one episode."""

    perception: EpisodePerception[TrackedHumans]
    expert: SpaceTimeExpert


class PerceivingDriver:
    """Drives by images, odometry, map and goal. It knows nothing else of people."""

    looks = True
    on_look: OnLook[TrackedHumans] | None = None
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
        looked = perceive_step(self._camera, [(simulation, state.perception) for simulation, state in running])
        if self.on_look is not None:
            for simulation, perception, image in looked:
                self.on_look(simulation, perception, image)
        decisions = [state.expert.act(simulation) for simulation, state in running]
        return [(decision.v_mps, decision.w_radps) for decision in decisions]


class TrackedExpert:
    """The expert with a student's eyes: people are tracked from what a network would tell of those in view.

    The errors of perception follow from the episode's key.
    """

    def __init__(
        self,
        expert: SpaceTimeExpert,
        people: TrackedHumans,
        episode: EpisodeKey,
        robot: RobotConfig,
        noise: PerceptionNoise,
    ) -> None:
        """Begin an episode.

        Args:
            expert: Plans among these people.
            people: The tracks.
            episode: Its errors of perception are drawn.
            robot: Of the episode.
            noise: How perception errs.
        """
        self._expert, self._people = expert, people
        self._perception = SimulatedPerception(noise, robot.camera, episode_rng(episode, Purpose.PERCEPTION))
        self._every, self._looked_step = max(1, robot.clock.steps(1.0 / noise.rate_hz)), -1

    @property
    def replan_times_s(self) -> Sequence[float]:
        """See `Expert.replan_times_s`."""
        return self._expert.replan_times_s

    def act(self, simulation: EpisodeSimulation) -> Decision:
        """See `Expert.act`."""
        visible = self.watch(simulation)
        return dataclasses.replace(self._expert.act(simulation), visible=visible)

    def watch(self, simulation: EpisodeSimulation) -> bool:
        """See `Expert.watch`."""
        visible = self._visible(simulation)
        if simulation.step % self._every == 0 and simulation.step != self._looked_step:
            self._look(simulation, visible)
        return bool(visible.any())

    def _visible(self, simulation: EpisodeSimulation) -> BoolArray:
        """Which humans are in view, shape (N,)."""
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        return np.array([self._people.eyes.show(pose, x, y) for x, y in simulation.human_xy_m.tolist()], np.bool_)

    def _look(self, simulation: EpisodeSimulation, visible: BoolArray) -> None:
        step, pose = simulation.step, (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        here, before = simulation.human_xy_m, simulation.human_xy_at(max(step - 2, 0))
        velocity = (here - before) / (max(min(step, 2), 1) * simulation.clock.dt_s)
        self._people.look(step, pose, self._perception.look(simulation.time_s, pose, here, velocity, visible))
        self._looked_step = step
