"""Perceive, track, act: a state policy drives on the map that it knows, among the people that the camera shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import UInt16Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.perception import PeopleTracker, Perception
from readygo.common.perception.episode import EpisodePerception, SteppedTracker, perceive_step
from readygo.common.perception.tracker import Pose
from readygo.common.policy.driver import PolicyCamera
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

    perception: EpisodePerception[SteppedTracker]
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
        # Tracks are brought to the present step before the policy is told of them.
        self._numbers = tracker_numbers(policy.spec.noise, policy.spec.robot.clock)._replace(every=1)
        self._told = np.empty((1, told_count(world)), np.float32)

    def start(self, simulation: EpisodeSimulation) -> ActingState:
        """See `Driver.start`."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        tracker = SteppedTracker(self._make_tracker(), simulation.clock.dt_s, self._shows)
        return ActingState(
            perception=EpisodePerception(self._perception, tracker, simulation.robot),
            field_cm=self._distances.to_goal_cm((goal_x, goal_y)),
            tracks=make_tracks(1, SLOTS),
        )

    def act(self, running: Sequence[tuple[EpisodeSimulation, ActingState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        perceive_step(self._camera, [(simulation, state.perception) for simulation, state in running])
        return [self._command(simulation, state) for simulation, state in running]

    def _shows(self, pose: Pose, x_m: float, y_m: float) -> bool:
        return bool(is_visible(self._world, *pose, x_m, y_m))

    def _command(self, simulation: EpisodeSimulation, state: ActingState) -> Command:
        if simulation.step % self._policy.spec.hold_steps == 0:
            one, people = simulation, state.perception.people
            people.advance(one.step)
            tell_tracks(people.tracker, state.tracks, one)
            goal_x, goal_y = one.scenario.goal_xy_m.tolist()
            robot = (one.x_m, one.y_m, one.yaw_rad, one.v_mps, one.w_radps)
            observe(
                self._world, self._numbers, state.tracks, 0, one.step, robot, (goal_x, goal_y), state.field_cm,
                self._told[0],
            )  # fmt: skip
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
