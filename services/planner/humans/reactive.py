"""People who yield: the drawn trajectories, walked again among each other and beside the expert's robot.

Each human follows the drawn rows and, at each step, takes the velocity of a fan around the wanted one that costs least:
how far it is off, and how soon it touches the robot or another human if all keep their course. A human ignores the
robot and other humans that are outside of its view or behind an obstacle. Walls are never touched.
Source: van den Berg, Lin, Manocha, Reciprocal velocity obstacles for real-time multi-agent navigation, ICRA 2008
(sampled velocities and the penalty of time to collision; here each one avoids fully instead of by half).
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.resample import place_between
from readygo.common.frames.turning import turn_between
from readygo.common.maps import OccupancyMap
from readygo.common.messages import EpisodeMotions, HumanMotion, Motion, Outcome, Scenario
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S, RATE_HZ
from readygo.services.planner.humans.polyline import length_m
from readygo.services.planner.humans.timing import first_rows
from readygo.services.planner.humans.velocity_choice import Cells, Sight, Wish, next_place, next_row

HUMAN_SIGHT = Sight(cos_half_cone=math.cos(0.5 * math.radians(200.0)), range_m=5.0)
"""Humans react within a cone of 200 degrees and 5 m."""
_AHEAD_ROWS = 20


class ReactiveHumans:
    """The humans of a scenario, step by step."""

    def __init__(
        self,
        drawn_m: Sequence[Float64Array],
        reacts: Sequence[bool],
        human_map: OccupancyMap,
        contact_m: float,
        episode: EpisodeConfig,
        *,
        sight: Sight = HUMAN_SIGHT,
    ) -> None:
        """Put everybody at their first row.

        Args:
            drawn_m: The drawn trajectories, shape (T, 2) each.
            reacts: Who yields; the others keep to their rows.
            human_map: What blocks humans.
            contact_m: Distance at which robot and human touch [m].
            episode: Radius of humans.
            sight: View in which humans notice the robot and each other.
        """
        self._drawn, self._reacts = drawn_m, np.array(reacts, np.bool_)
        self._radius_m = episode.human_radius_m
        frame = human_map.frame
        free = np.where(human_map.occupied, np.uint8(0), np.uint8(1))
        self._cells = Cells(human_map.occupied, free, frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
        self._sight = sight
        self._contact_m = contact_m
        self._row = [0] * len(drawn_m)
        self._velocity = np.array([_first_velocity(rows) for rows in drawn_m])
        self._heading = np.array([_unit(rows[-1] - rows[0]) for rows in drawn_m])
        self.xy_m = [np.array([rows[0] for rows in drawn_m])]
        """Positions by step, each of shape (N, 2)."""

    @property
    def at_rest(self) -> bool:
        """True if everybody has arrived."""
        arrived = all(row == len(rows) - 1 for row, rows in zip(self._row, self._drawn, strict=True))
        return arrived and bool(np.all(np.abs(self._velocity) < 0.02))

    def advance(self, robot: tuple[float, float, float, float] | None) -> None:
        """Advance all humans by one step.

        Args:
            robot: Its x, y [m] and velocity [m/s] in the world now; None if it is gone.
        """
        now, velocity = self.xy_m[-1], self._velocity.copy()
        place = now.copy()
        others = [(*now[k].tolist(), *velocity[k].tolist()) for k in range(len(now))]
        for k, rows in enumerate(self._drawn):
            if not self._reacts[k]:
                self._row[k] = min(self._row[k] + 1, len(rows) - 1)
                place[k] = rows[self._row[k]]
            else:
                place[k] = self._yielding(k, now[k], [o for j, o in enumerate(others) if j != k], robot)
            self._velocity[k] = (place[k] - now[k]) / DT_S
            if math.hypot(*self._velocity[k].tolist()) > 0.2:
                self._heading[k] = _unit(self._velocity[k])
        self.xy_m.append(place)

    def _yielding(
        self,
        k: int,
        here: Float64Array,
        others: list[tuple[float, float, float, float]],
        robot: tuple[float, float, float, float] | None,
    ) -> Float64Array:
        """Position of human k after this step."""
        rows = self._drawn[k]
        row = self._row[k] = next_row(rows, self._row[k], here)
        ahead = min(row + _AHEAD_ROWS, len(rows) - 1)
        ahead_s = max((ahead - row) * DT_S, 0.4)
        free_mps = max(1.1 * length_m(rows[row : ahead + 1]) / ahead_s, 0.4)
        discs = [(*other, 2 * self._radius_m) for other in others]
        if robot is not None:
            discs.append((*robot, self._contact_m))
        wish = Wish(
            here_m=here,
            velocity_mps=self._velocity[k],
            heading=self._heading[k],
            target_m=rows[ahead],
            speed_mps=min(free_mps, math.dist(here.tolist(), rows[ahead].tolist()) / ahead_s),
        )
        place: Float64Array = next_place(wish, np.array(discs).reshape(-1, 5), self._sight, self._cells, self._radius_m)
        return place


class Figure(Protocol):
    """What a human looks like who decides where to go as they go."""

    def advance(self, xy_m: Float64Array, velocity_mps: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Pelvis [m], shape (3,), and pose, shape (24, 3), of the next step; see `Motion`."""
        ...


class ReactiveSimulation(EpisodeSimulation):
    """An episode whose humans look at the robot, instead of following motions."""

    def __init__(
        self,
        scenario: Scenario,
        humans: ReactiveHumans,
        robot_map: OccupancyMap,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        *,
        animated: tuple[EpisodeMotions, Sequence[Figure]] | None = None,
    ) -> None:
        """Put the robot at its start.

        Args:
            scenario: Where everybody means to go.
            humans: Who decide as they go.
            robot_map: What blocks the robot.
            robot: Footprint and limits.
            episode_config: Task and judging.
            animated: How the humans stand at first, and what they look like after that; figures whose arms hang
                without, for those who look at places alone.
        """
        self._walkers = humans
        clock = robot.clock
        self._moving = stand_ins(scenario, clock.steps(episode_config.time_limit_s) + 1, clock.rate_hz)
        self._figures: Sequence[Figure] = ()
        if animated is not None:
            first, self._figures = animated
            for human, start in zip(self._moving.humans, first.humans, strict=True):
                human.motion.root_m[0, 2] = start.motion.root_m[0, 2]
                human.motion.pose_axis_angle[:] = start.motion.pose_axis_angle[0]
        self._looks = [
            [(human.motion.root_m[0].astype(np.float64), human.motion.pose_axis_angle[0].astype(np.float64))]
            for human in self._moving.humans
        ]
        """Root and pose of each human at all of its steps so far."""
        super().__init__(scenario, self._moving, robot_map, robot, episode_config)

    def motions_so_far(self) -> EpisodeMotions:
        """The steps that the humans have taken; other motions at every step."""
        rows = slice(self.step + 1)
        return EpisodeMotions(
            humans=tuple(
                HumanMotion(
                    avatar=human.avatar,
                    motion=Motion(
                        root_m=human.motion.root_m[rows],
                        pose_axis_angle=human.motion.pose_axis_angle[rows],
                        rate_hz=human.motion.rate_hz,
                    ),
                )
                for human in self._moving.humans
            )
        )

    def human_xy_at(self, step: int) -> Float64Array:
        """Where the humans are at a step [m], shape (N, 2); in the future, where they were drawn to be."""
        row, share = place_between(step, self.clock.rate_hz, RATE_HZ)
        walked = self._walkers.xy_m[row : row + 1 + math.ceil(share)]
        return _between(walked, share) if len(walked) > math.ceil(share) else super().human_xy_at(step)

    def advance(self, v_mps: float, w_radps: float) -> Outcome | None:
        """See `EpisodeSimulation.advance`; humans see where the robot is before it moves."""
        vx, vy = self.v_mps * math.cos(self.yaw_rad), self.v_mps * math.sin(self.yaw_rad)
        row, share = place_between(self.step + 1, self.clock.rate_hz, RATE_HZ)
        while len(self._walkers.xy_m) <= row + math.ceil(share):
            self._walk((self.x_m, self.y_m, vx, vy))
        now = self.human_xy_at(self.step + 1)
        for k, human in enumerate(self._moving.humans):
            human.motion.root_m[self.step + 1, :2] = now[k]
            if self._figures:
                self._dress(human.motion, self._looks[k][row : row + 2], share)
        return super().advance(v_mps, w_radps)

    def _walk(self, robot: tuple[float, float, float, float]) -> None:
        """The humans' next step, which is not the robot's where it has another clock."""
        self._walkers.advance(robot)
        before, now = self._walkers.xy_m[-2:]
        for k, figure in enumerate(self._figures):
            self._looks[k].append(figure.advance(now[k], (now[k] - before[k]) / DT_S))

    def _dress(self, motion: Motion, looks: Sequence[tuple[Float64Array, Float64Array]], share: float) -> None:
        """Fill the row of the robot's next step with a figure's pose, interpolated between two of its steps."""
        root_m, pose = looks[0]
        motion.root_m[self.step + 1], motion.pose_axis_angle[self.step + 1] = root_m, pose
        if share > 0:
            motion.root_m[self.step + 1] = _between([root_m for root_m, _ in looks], share)
            first, last = (pose.astype(np.float32) for _, pose in looks)
            turn_between(first, last, share, motion.pose_axis_angle[self.step + 1])


def stand_ins(scenario: Scenario, count: int, rate_hz: int) -> EpisodeMotions:
    """Motions of humans whose arms hang, along the drawn trajectories; the simulation moves them as it goes.

    Args:
        scenario: Where they mean to go.
        count: Rows of the motions.
        rate_hz: Rows per second.
    """
    humans = []
    for human in scenario.humans:
        root, pose = np.zeros((count, 3), np.float32), np.zeros((count, 24, 3), np.float32)
        drawn_m = first_rows(human.xy_m, count * RATE_HZ // rate_hz + 2)
        for step in range(count):
            row, share = place_between(step, rate_hz, RATE_HZ)
            root[step, :2] = _between(drawn_m[row : row + 2], share)
        root[:, 2] = 0.9
        # The shoulders: SMPL's figure without rotations holds its arms out.
        pose[:, 16, 2], pose[:, 17, 2] = -1.3, 1.3
        humans.append(
            HumanMotion(avatar=human.avatar, motion=Motion(root_m=root, pose_axis_angle=pose, rate_hz=rate_hz))
        )
    return EpisodeMotions(humans=tuple(humans))


def walked_scenario(scenario: Scenario, humans: ReactiveHumans) -> Scenario:
    """The scenario with the trajectories that its humans have walked, without the standing at their ends."""
    walked = np.array(humans.xy_m)
    trajectories = []
    for k, human in enumerate(scenario.humans):
        rows = walked[:, k]
        moving = np.flatnonzero(np.any(rows[1:] != rows[:-1], axis=1))
        last = int(moving[-1]) + 2 if len(moving) else 1
        trajectories.append(dataclasses.replace(human, xy_m=np.ascontiguousarray(rows[:last])))
    return dataclasses.replace(scenario, humans=tuple(trajectories))


def _first_velocity(rows: Float64Array) -> Float64Array:
    velocity: Float64Array = (rows[1] - rows[0]) / DT_S if len(rows) > 1 else np.zeros(2)
    return velocity


def _between(rows: Sequence[Float64Array] | Float64Array, share: float) -> Float64Array:
    """What is a share of the way from the first of two rows to the second; the first itself at 0."""
    between: Float64Array = rows[0] if share == 0 else rows[0] + share * (rows[1] - rows[0])
    return between


def _unit(vector: Float64Array) -> Float64Array:
    return vector / max(math.hypot(*vector.tolist()), 1e-9)
