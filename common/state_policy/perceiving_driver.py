"""Perceive, track, act: a state policy drives on the map that it knows, among the people that the camera shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import UInt8Array, UInt16Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.perception import PeopleTracker, Perception
from readygo.common.policy.driver import PolicyCamera
from readygo.common.policy.memory import PolicyMemory
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.observe import observe, told_count
from readygo.common.state_simulation.tracks import (
    Tracks,
    is_visible,
    make_tracks,
    tracker_numbers,
)
from readygo.common.state_simulation.world import StateWorld

SLOTS = 6
"""Most people that are told to the policy, of whom it takes the nearest ones."""


@dataclass(eq=False)
class ActingState:
    """What the driver remembers of one episode."""

    memory: PolicyMemory
    tracker: PeopleTracker
    field_cm: UInt16Array
    """Remaining distances to the goal."""
    tracks: Tracks
    """The tracker's people, as the policy is told of them."""
    command: Command = (0.0, 0.0)


class PerceivingStateDriver:
    """Drives by images, odometry, map and goal; a state policy decides."""

    looks = True

    def __init__(
        self,
        policy: StatePolicy,
        perception: Perception,
        camera: PolicyCamera,
        world: StateWorld,
        distances: GoalDistances,
        make_tracker: Callable[[], PeopleTracker],
    ) -> None:
        """Prepare a scene.

        Args:
            policy: Decides.
            perception: Tells what images show.
            camera: Where its images come from.
            world: Scene, robot and rules, with the policy's observation.
            distances: Of the robot's map.
            make_tracker: Makes the tracker of an episode.
        """
        self._policy, self._perception, self._camera = policy, perception, camera
        self._world, self._distances, self._make_tracker = world, distances, make_tracker
        self._numbers = tracker_numbers(policy.spec.noise, policy.spec.robot.clock)
        self._told = np.empty((1, told_count(world)), np.float32)

    def start(self, simulation: EpisodeSimulation) -> ActingState:
        """See `Driver.start`."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        return ActingState(
            memory=self._perception.start(),
            tracker=self._make_tracker(),
            field_cm=self._distances.to_goal_cm((goal_x, goal_y)),
            tracks=make_tracks(1, SLOTS),
        )

    def act(self, running: Sequence[tuple[EpisodeSimulation, ActingState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        for simulation, state in running:
            state.memory.advance(np.array((simulation.v_mps, simulation.w_radps), np.float32))
            if simulation.step > 0:
                state.tracker.predict(simulation.clock.dt_s)
        looking = [
            (simulation, state)
            for simulation, state in running
            if self._camera.arrives(simulation) and simulation.step % self._numbers.every == 0
        ]
        if looking:
            images = self._camera.look([simulation for simulation, _ in looking])
            for (simulation, state), image in zip(looking, images, strict=True):
                self._look(simulation, state, image)
        return [self._command(simulation, state) for simulation, state in running]

    def _look(self, simulation: EpisodeSimulation, state: ActingState, image: UInt8Array) -> None:
        state.memory.see(image)
        command = np.array((simulation.v_mps, simulation.w_radps), np.float32)
        people = self._perception.perceive(state.memory, command).people
        taken = max(simulation.step - simulation.clock.steps(simulation.robot.camera.latency_s), 0)
        x, y, yaw = simulation.path_xyyaw(taken, taken)[0].tolist()
        state.tracker.fuse((x, y, yaw), people, lambda hx, hy: bool(is_visible(self._world, x, y, yaw, hx, hy)))

    def _command(self, simulation: EpisodeSimulation, state: ActingState) -> Command:
        if simulation.step % self._policy.spec.hold_steps == 0:
            tell_tracks(state.tracker, state.tracks, simulation)
            goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
            one = simulation
            robot = (one.x_m, one.y_m, one.yaw_rad, one.v_mps, one.w_radps)
            # Tracks are of the present step: no time has passed since a look.
            numbers = self._numbers._replace(every=1)
            observe(
                self._world, numbers, state.tracks, 0, one.step, robot, (goal_x, goal_y), state.field_cm, self._told[0]
            )
            v, w = self._policy.choose(self._told)[0].tolist()
            state.command = v, w
        return state.command


def tell_tracks(tracker: PeopleTracker, tracks: Tracks, simulation: EpisodeSimulation) -> None:
    """Fill the tracks of a robot with those of a tracker, the nearest ones first.

    Args:
        tracker: Of the episode, predicted to the present step.
        tracks: Filled; row 0 is the robot's.
        simulation: The episode.
    """
    tracks.seen_step[0] = -1
    known = tracker.known
    known.sort(key=lambda track: (track.mean[0] - simulation.x_m) ** 2 + (track.mean[1] - simulation.y_m) ** 2)
    for slot, track in enumerate(known[: tracks.mean.shape[1]]):
        tracks.mean[0, slot], tracks.cov[0, slot] = track.mean, track.cov
        tracks.seen_step[0, slot] = max(simulation.step - round(track.age_s / simulation.clock.dt_s), 0)
        tracks.hits[0, slot] = track.hits
