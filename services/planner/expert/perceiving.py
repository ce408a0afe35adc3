"""Perceive, track, plan: the expert drives on the map that it knows, among the people that the robot's camera shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.perception import Perception
from readygo.common.perception.episode import EpisodePerception, OnLook, perceive_step
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.perception.simulated import SimulatedPerception
from readygo.common.policy.driver import PolicyCamera
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
