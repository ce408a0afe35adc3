"""Perceive, track, decide on a robot that knows its map, as the methods perceive-and-plan and perceive-and-act do."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Protocol, cast

import numpy as np

from readygo.apps.drive.people import SLACK
from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command
from readygo.common.errors import ConfigError, RunError
from readygo.common.frames import wrap_angle
from readygo.common.messages import EpisodeKey, Scenario, Split
from readygo.common.perception import People, Perception
from readygo.common.perception.episode import LOOK_S
from readygo.common.policy import Policy, PolicyMemory, PolicySpec
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.actor import RobotState, StateActor, tracker_for
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import StateWorld
from readygo.services.planner import Expert, RobotPlanner, TrackedHumans

_ASTRAY = 0.3
"""The robot is taken to move by its last command, unless its motion differs from that by more [m/s, rad/s]."""
_NOBODY: Float64Array = np.empty((0, 2))
Pose = tuple[float, float, float]


class Decider(Protocol):
    """Decides in one trial, by the robot's pose on the map and what was perceived."""

    def look(self, step: int, pose: Pose, people: People) -> None:
        """See `readygo.common.perception.episode.TakesLooks`."""
        ...

    def act(self, robot: RobotState) -> Command:
        """The command now: v [m/s], w [rad/s]."""
        ...


MakeDecider = Callable[[Pose, tuple[float, float]], Decider]
"""Makes what decides in a trial, from its start pose and its goal on the map."""


@dataclass(frozen=True, eq=False)
class Planning:
    """The planner decides, among the people that are tracked for it."""

    expert: Expert
    people: TrackedHumans

    def look(self, step: int, pose: Pose, people: People) -> None:
        """See `Decider.look`."""
        self.people.look(step, pose, people)

    def act(self, robot: RobotState) -> Command:
        """See `Decider.act`; where people truly are is not asked."""
        decision = self.expert.act(cast(EpisodeSimulation, robot))
        return decision.v_mps, decision.w_radps


def planning(planner: RobotPlanner) -> MakeDecider:
    """The planner decides."""

    def make(start: Pose, goal: tuple[float, float]) -> Decider:
        episode = EpisodeKey(seed=0, split=Split.TEST, index=0)
        scenario = Scenario(episode=episode, start_xyyaw=np.array(start), goal_xy_m=np.array(goal), humans=())
        return Planning(*planner.tracked_expert(scenario))

    return make


def acting(policy: StatePolicy, world: StateWorld, distances: GoalDistances, planner: RobotPlanner) -> MakeDecider:
    """A state policy decides; arguments as for `StateActor`, and people are tracked on the planner's map."""
    ground = planner.ground

    def make(start: Pose, goal: tuple[float, float]) -> Decider:
        tracker = tracker_for(policy, ground.human_clearance, ground.human_frame)
        return StateActor(policy, world, distances, tracker, goal)

    return make


class PerceivingPolicy(Policy):
    """A policy for one trial that perceives people, tracks them and decides among them on the map of a scene."""

    def __init__(
        self, perception: Perception, planner: RobotPlanner, make_decider: MakeDecider, start: Pose | None = None
    ) -> None:
        """Prepare a trial.

        Args:
            perception: Tells what images show.
            planner: Knows the map, and the robot that perception was trained with.
            make_decider: Makes what decides.
            start: Where the trial begins in the scene: x, y [m], yaw [rad]; None for odometry in the scene's frame.
        """
        super().__init__(PolicySpec(robot=planner.robot))
        self._perception, self._ground, self._make_decider = perception, planner.ground, make_decider
        self._start = start
        self._turn_rad, self._shift_m = 0.0, (0.0, 0.0)
        self._begun_ns: int | None = None
        self._looked_ns: int | None = None
        self._decider: Decider | None = None
        self._waiting: list[tuple[int, Pose, People]] = []
        self._command = self._moving = np.zeros(2, np.float32)

    def start(self, robot: RobotConfig | None = None) -> PolicyMemory:
        """Memory of the trial's images and odometry."""
        return self._perception.start()

    def see(self, memories: Sequence[PolicyMemory], images: UInt8Array, times_ns: Sequence[int | None] = ()) -> None:
        """Look at an image, ten times a second."""
        (memory,), (image,), (time_ns,) = memories, images, times_ns
        assert time_ns is not None
        if self._looked_ns is not None and (time_ns - self._looked_ns) / 1e9 < SLACK * LOOK_S:
            return
        self._looked_ns = time_ns
        memory.see(image, time_ns)
        perceived = self._perception.perceive(memory, self._moving)
        self._waiting.append((time_ns, memory.pose_at(time_ns), perceived.people))

    def decide(
        self, memories: Sequence[PolicyMemory], commands: Float32Array, goals_xy_m: Float32Array
    ) -> Float32Array:
        """The command now.

        Raises:
            RunError: If the robot is beyond the map.
        """
        (memory,), self._moving = memories, commands[0]
        now_ns, odometry = memory.newest_pose
        if self._begun_ns is None:
            self._begun_ns = now_ns
            self._place(odometry)
        pose = self._in_scene(odometry)
        if self._decider is None:
            self._decider = self._begin(pose, goals_xy_m[0].tolist())
        for time_ns, taken, seen in self._waiting:
            self._decider.look(self._step(time_ns), self._in_scene(taken), seen)
        self._waiting.clear()
        self._check_inside(pose)
        self._command = np.array(self._decider.act(self._robot_at(self._step(now_ns), pose)), np.float32)
        return self._command[None]

    def _robot_at(self, step: int, pose: Pose) -> RobotState:
        """What is asked of an episode."""
        astray = bool(np.abs(self._command - self._moving).max() > _ASTRAY)
        v_mps, w_radps = (self._moving if astray else self._command).tolist()
        x_m, y_m, yaw_rad = pose
        return cast(
            RobotState,
            SimpleNamespace(
                step=step, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, v_mps=v_mps, w_radps=w_radps, human_xy_m=_NOBODY
            ),
        )

    def _step(self, time_ns: int) -> int:
        assert self._begun_ns is not None
        return max(self.spec.robot.clock.steps((time_ns - self._begun_ns) / 1e9), 0)

    def _place(self, odometry: Pose) -> None:
        """Find the pose of the odometry's frame in the scene."""
        if self._start is None:
            return
        x, y, yaw = self._start
        self._turn_rad = yaw - odometry[2]
        c, s = math.cos(self._turn_rad), math.sin(self._turn_rad)
        self._shift_m = x - c * odometry[0] + s * odometry[1], y - s * odometry[0] - c * odometry[1]

    def _in_scene(self, odometry: Pose) -> Pose:
        c, s = math.cos(self._turn_rad), math.sin(self._turn_rad)
        x, y, yaw = odometry
        dx, dy = self._shift_m
        return c * x - s * y + dx, s * x + c * y + dy, float(wrap_angle(yaw + self._turn_rad))

    def _begin(self, pose: Pose, goal_xy_robot_m: Sequence[float]) -> Decider:
        """What decides in the trial.

        Raises:
            ConfigError: If start or goal is not free on the map.
        """
        x, y, yaw = pose
        c, s = math.cos(yaw), math.sin(yaw)
        ahead, left = goal_xy_robot_m
        goal = x + c * ahead - s * left, y + s * ahead + c * left
        for name, place in (("start", (x, y)), ("goal", goal)):
            if self._clearance_m(*place) < self.spec.robot.radius_m:
                raise ConfigError(
                    f"The {name} ({place[0]:.2f}, {place[1]:.2f}) is not free on the scene's map; is the odometry in "
                    "the scene's frame, or --start right?"
                )
        return self._make_decider(pose, goal)

    def _check_inside(self, pose: Pose) -> None:
        if self._clearance_m(*pose[:2]) < 0:
            raise RunError(f"The robot is beyond the scene's map, at ({pose[0]:.2f}, {pose[1]:.2f}).")

    def _clearance_m(self, x_m: float, y_m: float) -> float:
        """Distance to what blocks the robot [m]; -1 beyond the map."""
        ground = self._ground
        i, j = ground.occupancy.frame.cell(x_m, y_m)
        rows, columns = ground.clearance.shape
        return float(ground.clearance[i, j]) if 0 <= i < rows and 0 <= j < columns else -1.0
