"""A state policy over one episode or trial, among the people that a tracker has from images."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode.loop import Command
from readygo.common.maps import GridFrame
from readygo.common.perception import People, PeopleTracker
from readygo.common.perception.episode import SteppedTracker
from readygo.common.perception.tracker import Pose
from readygo.common.state_policy.commands import StateCommands
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.observe import observe, told_count
from readygo.common.state_simulation.tracks import Tracks, has_no_tracks, is_visible, make_tracks, tracker_numbers
from readygo.common.state_simulation.world import StateWorld

SLOTS = 6
"""Most people that are told to the policy, of whom it takes the nearest ones."""


def tracker_for(policy: StatePolicy, clearance_m: Float64Array | None, frame: GridFrame | None) -> PeopleTracker:
    """A tracker for a policy's episode: it fuses told velocities only if the policy learned from such.

    Args:
        policy: Decides.
        clearance_m: As for `PeopleTracker`.
        frame: As for `PeopleTracker`.
    """
    return PeopleTracker(clearance_m, frame, velocities=policy.spec.noise.measures_velocity)


class RobotState(Protocol):
    """The robot on the map now: of a simulated episode, or by its odometry."""

    @property
    def step(self) -> int:
        """Steps of the robot's clock since the beginning."""
        ...

    @property
    def x_m(self) -> float:
        """Position on the map [m]."""
        ...

    @property
    def y_m(self) -> float:
        """Position on the map [m]."""
        ...

    @property
    def yaw_rad(self) -> float:
        """Heading [rad]."""
        ...

    @property
    def v_mps(self) -> float:
        """Speed [m/s]."""
        ...

    @property
    def w_radps(self) -> float:
        """Yaw rate [rad/s]."""
        ...


class StateActor:
    """Decides by a state policy: on the map that it knows, among tracked people."""

    def __init__(
        self,
        policy: StatePolicy,
        world: StateWorld,
        distances: GoalDistances,
        tracker: PeopleTracker,
        goal_xy_m: Sequence[float],
    ) -> None:
        """Begin.

        Args:
            policy: Decides.
            world: Scene, robot and rules, with the policy's observation.
            distances: Of the robot's map.
            tracker: Has no people yet.
            goal_xy_m: Goal on the map [m].
        """
        self._commands, self._world = StateCommands(policy), world
        # Tracks are brought to the present step before the policy is told of them.
        self._numbers = tracker_numbers(policy.spec.noise, policy.spec.robot.clock)._replace(every=1)
        self._dt_s, self._hold_steps = policy.spec.robot.clock.dt_s, policy.spec.hold_steps
        goal_x, goal_y = goal_xy_m
        self._goal = goal_x, goal_y
        self._field_cm = distances.to_goal_cm(self._goal)
        self.people = SteppedTracker(tracker, self._dt_s, self._shows)
        """The tracks."""
        self.tracks: Tracks = make_tracks(1, SLOTS)
        """The tracker's people, as the policy is told of them."""
        self.told = np.empty((1, told_count(world)), np.float32)
        """What the policy was told at its last decision."""
        self._command: Command = (0.0, 0.0)
        self._due_step = 0

    def look(self, step: int, pose: Pose, people: People) -> None:
        """See `readygo.common.perception.episode.TakesLooks`."""
        self.people.look(step, pose, people)

    def act(self, robot: RobotState) -> Command:
        """The command now: v [m/s], w [rad/s]; one that was decided less than `hold_s` ago is held."""
        if robot.step >= self._due_step:
            self._due_step = (robot.step // self._hold_steps + 1) * self._hold_steps
            self._decide(robot)
        return self._command

    def _decide(self, robot: RobotState) -> None:
        self.people.advance(robot.step)
        self._tell_tracks(robot)
        state = (robot.x_m, robot.y_m, robot.yaw_rad, robot.v_mps, robot.w_radps)
        observe(self._world, self._numbers, self.tracks, 0, robot.step, state, self._goal, self._field_cm, self.told[0])
        time_s, xy_m = np.array([robot.step * self._dt_s]), np.array([[robot.x_m, robot.y_m]])
        v, w = self._commands.decide(self.told, time_s, xy_m, has_no_tracks(self.tracks))[0].tolist()
        self._command = v, w

    def _tell_tracks(self, robot: RobotState) -> None:
        """Fill the tracks with those of the tracker, the nearest ones first."""
        tracks, known = self.tracks, self.people.tracker.known
        tracks.seen_step[0] = -1
        known.sort(key=lambda track: (track.mean[0] - robot.x_m) ** 2 + (track.mean[1] - robot.y_m) ** 2)
        for slot, track in enumerate(known[: tracks.mean.shape[1]]):
            tracks.mean[0, slot], tracks.cov[0, slot] = track.mean, track.cov
            tracks.seen_step[0, slot] = max(robot.step - round(track.age_s / self._dt_s), 0)
            tracks.hits[0, slot] = track.hits

    def _shows(self, pose: Pose, x_m: float, y_m: float) -> bool:
        return bool(is_visible(self._world, *pose, x_m, y_m))
