"""A state policy as a driver of the project's episodes: told the same as in the state simulation, by the same code."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, UInt16Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.state_policy.commands import StateCommands
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.observe import observe, told_count
from readygo.common.state_simulation.tracks import (
    Tracks,
    begin_tracks,
    has_no_tracks,
    is_visible,
    look,
    make_tracks,
    tracker_numbers,
)
from readygo.common.state_simulation.world import StateWorld


@dataclass(eq=False)
class StateEpisode:
    """What the driver keeps of one episode."""

    field_cm: UInt16Array
    """Remaining distances to the goal."""
    tracks: Tracks
    commands: StateCommands
    command: Command = (0.0, 0.0)


class StateDriver:
    """Drives by a state policy; people are told by a tracker from simulated detections of those in view.

    The detections' errors follow from the episode's key.
    """

    looks = False

    def __init__(
        self,
        policy: StatePolicy,
        world: StateWorld,
        distances: GoalDistances,
        noise: PerceptionNoise | None = None,
    ) -> None:
        """Prepare a scene.

        Args:
            policy: The policy.
            world: Scene, robot and rules, with the policy's observation.
            distances: Of the robot's map.
            noise: Errors of perception; those of the policy's training by default.
        """
        self._policy, self._world, self._distances = policy, world, distances
        self._numbers = tracker_numbers(noise or policy.spec.noise, policy.spec.robot.clock)
        self.hold_steps, self._dt_s = policy.spec.hold_steps, policy.spec.robot.clock.dt_s
        self._told = np.empty((1, told_count(world)), np.float32)

    def start(self, simulation: EpisodeSimulation) -> StateEpisode:
        """Measure all ways to the goal, and know of no people."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        tracks = make_tracks(1, max(len(simulation.scenario.humans), simulation.config.human_count_max))
        begin_tracks(tracks, 0, detection_seed(simulation))
        field_cm = self._distances.to_goal_cm((goal_x, goal_y))
        return StateEpisode(field_cm=field_cm, tracks=tracks, commands=StateCommands(self._policy))

    def act(self, running: Sequence[tuple[EpisodeSimulation, StateEpisode]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        return [self._command(simulation, episode) for simulation, episode in running]

    def told(self, simulation: EpisodeSimulation, episode: StateEpisode) -> Float32Array:
        """What the robot is told now, shape (1, told_count); the next call overwrites it."""
        one, (goal_x, goal_y) = simulation, simulation.scenario.goal_xy_m.tolist()
        state = (one.x_m, one.y_m, one.yaw_rad, one.v_mps, one.w_radps)
        observe(
            self._world, self._numbers, episode.tracks, 0, one.step, state, (goal_x, goal_y), episode.field_cm,
            self._told[0],
        )  # fmt: skip
        return self._told

    def perceive(self, simulation: EpisodeSimulation, episode: StateEpisode) -> None:
        """Detect the people in view, at the steps of looks; call it at every step."""
        one = simulation
        if one.step % self._numbers.every == 0:
            human_xy_m = np.ascontiguousarray(one.human_xy_m)
            pose = (one.x_m, one.y_m, one.yaw_rad)
            look(self._world, self._numbers, episode.tracks, 0, one.step, pose, human_xy_m, len(human_xy_m))

    def decide(self, simulation: EpisodeSimulation, episode: StateEpisode) -> Command:
        """The policy's command at the present state, which was perceived before: v [m/s], w [rad/s]."""
        one, told, alone = simulation, self.told(simulation, episode), has_no_tracks(episode.tracks)
        time_s, xy_m = np.array([one.step * self._dt_s]), np.array([[one.x_m, one.y_m]])
        v, w = episode.commands.decide(told, time_s, xy_m, alone)[0].tolist()
        return v, w

    def sees_human(self, simulation: EpisodeSimulation) -> bool:
        """True if one of the robot's cameras shows a human now."""
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        return any(is_visible(self._world, *pose, x_m, y_m) for x_m, y_m in simulation.human_xy_m.tolist())

    def _command(self, simulation: EpisodeSimulation, episode: StateEpisode) -> Command:
        self.perceive(simulation, episode)
        if simulation.step % self.hold_steps == 0:
            episode.command = self.decide(simulation, episode)
        return episode.command


def detection_seed(simulation: EpisodeSimulation) -> int:
    """Seed of the errors of detection in an episode."""
    return int(episode_rng(simulation.scenario.episode, Purpose.PERCEPTION).integers(2**62))
