"""The expert after the ReaDy-Go paper: humans and their straight predictions are ground that a path avoids."""

import enum
import math
import time

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import footprint_xy
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.grid_search import UNREACHED
from readygo.common.messages import Scenario
from readygo.services.planner.expert.cost_factors import (
    open_around,
    paint_capsule,
    paint_points,
    paint_slope,
    path_cost,
    path_distance,
)
from readygo.services.planner.expert.ground import HIGH_FACTOR, TIGHT_MARGIN_M, SceneGround
from readygo.services.planner.expert.hybrid_astar import TURN_COST_M, HybridAStar, Plan
from readygo.services.planner.expert.interface import Decision, HumanBody, expected_array
from readygo.services.planner.expert.perception import HumanTracks, PerceivedHuman
from readygo.services.planner.expert.records import state_of
from readygo.services.planner.expert.rollouts import AHEAD_S
from readygo.services.planner.expert.tracking import PathTracker

_PREDICTION_S = 2.0
"""Constant-velocity prediction of humans [s] (paper)."""
_NEAR_M = 3.0
"""A visible human enters the map if this near to the plan [m] (paper: "a safety margin")."""
_BUFFER_M = 0.25
"""Added to the human's radius along the prediction, and around the avatar's Gaussians [m]."""
_REPLAN_PERIOD_S = 0.5
"""Time after which a path is planned again [s]."""
_REPLAN_INTERVAL_MIN_S = 0.1
"""Least time between two replans [s]."""
_REPLAN_DISTANCE_M = 1.5
"""A human this near to the path ahead triggers a replan [m]."""
_REPLAN_LOOKAHEAD_S = 2.0
"""Length of this path ahead, in time at full speed [s]."""
_KEEP_RATIO = 1.25
"""The old plan stays if it is free and costs at most this many times as much as the new one."""
_START_GAP_M = 0.03
_CONTACT_GAP_M = 0.03
_STANDING_MPS = 0.1
_OFF_PATH_M = 0.15
_NEVER = -(1 << 20)


class _Margin(enum.Enum):
    """How much room a search leaves around predicted humans and walls."""

    FULL = enum.auto()
    """Planning radius at walls, buffer and avatar footprint at humans."""
    CONTACT = enum.auto()
    """No margin beyond contact."""
    NOW = enum.auto()
    """No contact with humans where they are now; predicted ground is costly."""


class PaperExpert:
    """Drives one episode in mode "paper"; call `act` at every step."""

    def __init__(self, ground: SceneGround, search: HybridAStar, scenario: Scenario, bodies: list[HumanBody]) -> None:
        """Prepare the static way to the goal.

        Args:
            ground: What all episodes in the scene share.
            search: Searches, shared by all episodes.
            scenario: Start and goal.
            bodies: Motion, avatar and footprint of every human, in the order of the scenario.
        """
        self._ground, self._search_memory, self._bodies = ground, search, bodies
        self._goal = scenario.goal_xy_m
        start = (float(scenario.start_xyyaw[0]), float(scenario.start_xyyaw[1]))
        self._goal_m = (float(self._goal[0]), float(self._goal[1]))
        self._local = ground.around(start, self._goal_m)
        self._clock = ground.robot.clock
        self._ahead_steps = self._clock.steps(AHEAD_S)
        paths_m = [body.human.motion.root_m[:, :2].astype(np.float64) for body in bodies]
        self._tracks = HumanTracks(ground, self._local, paths_m, self._ahead_steps)
        self._tracker = PathTracker(self._local, ground.robot, ground.contact_m)
        self._plan: Plan | None = None
        self._planned_at_step = _NEVER
        self._latest_factor = self._local.static_factor
        self._decided: tuple[int, Decision] | None = None
        self.replan_times_s: list[float] = []
        """CPU time of each replan [s]."""

    def act(self, simulation: EpisodeSimulation) -> Decision:
        """Decide on the next command."""
        if self._decided is None or self._decided[0] != simulation.step:
            self._decided = simulation.step, self._decide(simulation)
        return self._decided[1]

    def watch(self, simulation: EpisodeSimulation) -> bool:
        """Look without deciding; True if a human is in view."""
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        return any(human.seen for human in self._tracks.observe(simulation.step, pose, simulation.human_xy_m))

    def _decide(self, simulation: EpisodeSimulation) -> Decision:
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        if not self._local.holds(pose[0], pose[1]):
            self._move_window(pose[:2])
        humans = self._tracks.observe(simulation.step, pose, simulation.human_xy_m)
        self._tracker.update(pose[0], pose[1])
        near = [human for human in humans if self._is_near_plan(human)]
        replanned = self._is_due(simulation.step, near)
        if replanned:
            started_s = time.thread_time()
            self._replan(simulation, near)
            self.replan_times_s.append(time.thread_time() - started_s)
        expected_m = expected_array(humans, self._ahead_steps)
        v, w = self._drive(simulation, expected_m)
        return Decision(
            v_mps=v,
            w_radps=w,
            replanned=replanned,
            cost=0.0 if self._plan is None else self._plan.cost,
            visible=any(human.seen for human in humans),
            commands=np.array([(v, w)]),
            path_xy_m=self._tracker.path[self._tracker.progress :, :2],
            perceived=tuple(humans),
        )

    def _move_window(self, here_m: tuple[float, float]) -> None:
        """Start again with another part of the map, at a position where the episode was not expected."""
        self._local = self._tracks.local = self._ground.around(here_m, self._goal_m)
        self._tracker = PathTracker(self._local, self._ground.robot, self._ground.contact_m)
        self._plan, self._planned_at_step = None, _NEVER
        self._latest_factor = self._local.static_factor

    def _is_near_plan(self, human: PerceivedHuman) -> bool:
        if self._plan is None:
            return True
        return self._gap_m(human, len(self._tracker.path)) < _NEAR_M

    def _gap_m(self, human: PerceivedHuman, last: int) -> float:
        """Distance between the path ahead and the human's predicted ground, by centre lines [m]."""
        ends = self._capsule(human)
        position = (human.x_m, human.y_m, human.x_m, human.y_m)
        path, progress = self._tracker.path, self._tracker.progress
        radius_m = self._ground.contact_m + _BUFFER_M
        inside = path_distance(path, progress, last, ends) < radius_m
        return 0.0 if inside else float(path_distance(path, progress, last, position))

    def _capsule(self, human: PerceivedHuman) -> tuple[float, float, float, float]:
        t = _PREDICTION_S
        return human.x_m, human.y_m, human.x_m + t * human.vx_mps, human.y_m + t * human.vy_mps

    def _is_due(self, step: int, near: list[PerceivedHuman]) -> bool:
        elapsed_s = (step - self._planned_at_step) / self._clock.rate_hz
        if elapsed_s < _REPLAN_INTERVAL_MIN_S - 1e-9:
            return False
        if self._plan is None or elapsed_s >= _REPLAN_PERIOD_S - 1e-9:
            return True
        ahead = self._tracker.progress + int(_REPLAN_LOOKAHEAD_S * self._ground.robot.v_max_mps / 0.05) + 1
        return any(self._gap_m(human, ahead) < _REPLAN_DISTANCE_M for human in near)

    def _replan(self, simulation: EpisodeSimulation, near: list[PerceivedHuman]) -> None:
        """Search again with decreasing margins; on failure the old plan stays."""
        self._planned_at_step = simulation.step
        for margin in _Margin if near else (_Margin.FULL, _Margin.CONTACT):
            plan = self._search(simulation, near, margin)
            if plan is not None:
                if not self._is_old_as_good(plan, simulation):
                    self._plan = plan
                    self._tracker.follow(plan, simulation.yaw_rad)
                return

    def _is_old_as_good(self, plan: Plan, simulation: EpisodeSimulation) -> bool:
        """True if the rest of the old plan is free on the latest map and hardly longer; switching costs smoothness."""
        frame, tracker = self._local.frame, self._tracker
        if self._plan is None or tracker.turning or tracker.gap_m(simulation.x_m, simulation.y_m) > _OFF_PATH_M:
            return False
        new = np.column_stack([plan.xyyaw, plan.speed_mps])
        turn = plan.xyyaw[0, 2] - simulation.yaw_rad
        turn_m = TURN_COST_M * abs((turn + math.pi) % (2 * math.pi) - math.pi)
        v_max = self._ground.robot.v_max_mps
        old_m = path_cost(tracker.path, tracker.progress, self._latest_factor, frame, v_max)
        new_m = turn_m + path_cost(new, 0, self._latest_factor, frame, v_max)
        return bool(old_m <= _KEEP_RATIO * new_m)

    def _search(self, simulation: EpisodeSimulation, near: list[PerceivedHuman], margin: _Margin) -> Plan | None:
        ground, local = self._ground, self._local
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        i, j = local.frame.cell(pose[0], pose[1])
        factor, heuristic = local.static_factor, local.to_goal
        if near or margin is not _Margin.FULL or factor[i, j] == 0:
            factor, heuristic = local.factor, local.heuristic
            factor[:] = local.static_factor if margin is _Margin.FULL else local.tight_factor
            # A robot that stands nearer to a wall than planned must be able to leave.
            tolerated_m = min(ground.robot.radius_m + TIGHT_MARGIN_M, local.clearance[i, j] - 0.02)
            open_around(factor, local.frame, local.clearance, pose[:2], tolerated_m, HIGH_FACTOR)
            for human in near:
                self._paint(factor, human, simulation.step, pose[:2], margin)
            local.distances(factor, pose[0], pose[1])
        if heuristic[i, j] >= UNREACHED:
            return None
        self._latest_factor = factor
        standing = abs(simulation.v_mps) < _STANDING_MPS
        return self._search_memory.search(factor, heuristic, local.frame, pose, self._goal, turn_first=standing)

    def _paint(
        self, factor: UInt8Array, human: PerceivedHuman, step: int, robot_m: tuple[float, float], margin: _Margin
    ) -> None:
        """Put a human into the map: blocked ground, costly around it and wherever the robot itself stands in it."""
        ground, frame = self._ground, self._local.frame
        ends = self._capsule(human)
        at = (human.x_m, human.y_m, human.x_m, human.y_m)
        here = np.array([robot_m])
        to_ends_m, to_human_m = path_distance(here, 0, 1, ends), path_distance(here, 0, 1, at)
        full_m = ground.robot.planning_radius_m + ground.human_radius_m + _BUFFER_M
        contact_m = ground.contact_m + _CONTACT_GAP_M
        paint_slope(factor, frame, ends, full_m, HIGH_FACTOR)
        if margin is _Margin.FULL:
            reach_m = ground.robot.planning_radius_m + _BUFFER_M
            points = self._footprint(human, step)
            to_points_m = math.sqrt(float(np.min(np.sum((points - here) ** 2, axis=1))))
            paint_capsule(factor, frame, ends, min(full_m, to_ends_m - _START_GAP_M), 0)
            paint_points(factor, frame, points, min(reach_m, to_points_m - _START_GAP_M), 0)
        elif margin is _Margin.CONTACT:
            paint_capsule(factor, frame, ends, min(contact_m, to_ends_m - _START_GAP_M), 0)
        paint_capsule(factor, frame, at, min(contact_m, to_human_m - _START_GAP_M), 0)

    def _footprint(self, human: PerceivedHuman, step: int) -> Float64Array:
        """Ground points of the posed avatar if it is seen now, else the point where it is expected."""
        if not human.seen:
            return np.array([[human.x_m, human.y_m]])
        body = self._bodies[human.index]
        return footprint_xy(body.footprint, body.avatar, body.human.motion, step)

    def _drive(self, simulation: EpisodeSimulation, expected_m: Float64Array) -> tuple[float, float]:
        state, held_steps = state_of(simulation), self._clock.held_for(simulation.step)
        if self._plan is None:
            turn_rad = self._local.way_out_rad(*state[:3], self._goal_m)
            return self._tracker.turn(state, turn_rad, expected_m, held_steps=held_steps)
        return self._tracker.command(state, expected_m, held_steps=held_steps)
