"""The robot expert: sees humans only where its camera could, plans with Hybrid A*, drives within its limits."""

import enum
import math
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.avatars import Avatar, FootprintModel, footprint_xy
from common.episode import EpisodeConfig, EpisodeSimulation, GridSearch
from common.episode.grid_search import UNITS_PER_CELL, UNREACHED
from common.maps import OccupancyMap, clearance_m
from common.messages import HumanMotion, Scenario
from common.robot import RobotConfig
from common.robot.kinematics import RATE_HZ
from services.planner.expert_config import ExpertConfig
from services.planner.hybrid_astar import HybridAStar, Plan
from services.planner.obstacles import (
    open_around,
    paint_capsule,
    paint_points,
    paint_slope,
    path_cost,
    path_distance,
    static_factor,
)
from services.planner.perception import HumanTracks, PerceivedHuman
from services.planner.rollouts import AHEAD_STEPS, State
from services.planner.tracking import PathTracker

Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]

_HEURISTIC_SLACK_M = 1.5
_START_GAP_M = 0.03
_CONTACT_GAP_M = 0.03
_STANDING_MPS = 0.1
_OFF_PATH_M = 0.15


class _Margin(enum.Enum):
    """How much room a search leaves around predicted humans and walls."""

    FULL = enum.auto()
    """Planning radius at walls, buffer and avatar footprint at humans."""
    CONTACT = enum.auto()
    """Just no contact."""
    NOW = enum.auto()
    """No contact with humans where they are now; predicted ground is dear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """What the expert does in one step, and why."""

    v_mps: float
    w_radps: float
    replanned: bool
    """True if a search ran at this step."""
    cost: float
    """Cost of the plan in force; 0 without a plan."""
    visible: bool
    """True if a human is in view."""
    path_xy_m: Float64Array
    """What is left of the path in force [m], shape (N, 2); empty without a plan. A view: copy it to keep it."""
    perceived: tuple[PerceivedHuman, ...]
    """The humans that the expert knows of."""


class ExpertGround:
    """What all episodes on one map share: distances, cost factors and search memory. Not thread-safe."""

    def __init__(
        self, occupancy: OccupancyMap, robot: RobotConfig, episode_config: EpisodeConfig, config: ExpertConfig
    ) -> None:
        self.occupancy, self.robot, self.config = occupancy, robot, config
        self.human_radius_m = episode_config.human_radius_m
        self.contact_m = robot.radius_m + episode_config.human_radius_m
        self.frame = occupancy.frame
        self.clearance = clearance_m(occupancy).astype(np.float64)
        self.static_factor = static_factor(
            self.clearance,
            robot.planning_radius_m + config.cell_margin_m,
            wall_cost=config.wall_cost,
            wall_distance_m=config.wall_distance_m,
        )
        tight = (self.clearance > robot.radius_m + config.tight_margin_m) & (self.static_factor == 0)
        self.tight_factor = np.where(tight, np.uint8(config.dear_factor), self.static_factor)
        self.search = GridSearch(self.clearance.shape)
        self.hybrid = HybridAStar(self.frame, robot, config)
        self.factor = np.empty_like(self.static_factor)
        self.heuristic = np.empty(self.clearance.shape, np.int32)


class RobotExpert:
    """Drives one episode in the paper's mode; call `act` at every step."""

    def __init__(
        self,
        ground: ExpertGround,
        scenario: Scenario,
        people: list[tuple[HumanMotion, Avatar, FootprintModel]],
    ) -> None:
        """Prepare the static way to the goal.

        Args:
            ground: What all episodes on the map share.
            scenario: Start and goal.
            people: Motion, avatar and footprint of every human, in the order of the scenario.
        """
        config = ground.config
        self._ground, self._config, self._people = ground, config, people
        self._goal = scenario.goal_xy_m
        self._goal_cell = ground.frame.cell(float(self._goal[0]), float(self._goal[1]))
        self._static_heuristic = ground.search.distances(ground.static_factor, self._goal_cell)
        self._tracks = HumanTracks(
            ground.occupancy, ground.robot.camera.horizontal_fov_deg, ground.human_radius_m, config
        )
        self._tracker = PathTracker(
            ground.occupancy, ground.clearance, self._static_heuristic, ground.robot, ground.contact_m, config
        )
        self._plan: Plan | None = None
        self._planned_at_step = -(1 << 20)
        self._latest_factor = ground.static_factor
        self.replan_times_s: list[float] = []
        """CPU time of each replan [s]."""

    def act(self, simulation: EpisodeSimulation) -> Decision:
        """Decide on the next command."""
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        humans = self._tracks.observe(simulation.step, pose, simulation.human_xy_m)
        self._tracker.update(pose[0], pose[1])
        near = [human for human in humans if self._is_near_plan(human)]
        replanned = self._is_due(simulation.step, near)
        if replanned:
            started_s = time.thread_time()
            self._replan(simulation, near)
            self.replan_times_s.append(time.thread_time() - started_s)
        v, w = self._drive(simulation, humans)
        return Decision(
            v_mps=v,
            w_radps=w,
            replanned=replanned,
            cost=0.0 if self._plan is None else self._plan.cost,
            visible=any(human.seen for human in humans),
            path_xy_m=self._tracker.path[self._tracker.progress :, :2],
            perceived=tuple(humans),
        )

    def _is_near_plan(self, human: PerceivedHuman) -> bool:
        if self._plan is None:
            return True
        return self._gap_m(human, len(self._tracker.path)) < self._config.near_m

    def _gap_m(self, human: PerceivedHuman, last: int) -> float:
        """Distance between the path ahead and the human's predicted ground, by centre lines [m]."""
        ends = self._capsule(human)
        position = (human.x_m, human.y_m, human.x_m, human.y_m)
        path, progress = self._tracker.path, self._tracker.progress
        radius_m = self._ground.contact_m + self._config.buffer_m
        inside = path_distance(path, progress, last, ends) < radius_m
        return 0.0 if inside else float(path_distance(path, progress, last, position))

    def _capsule(self, human: PerceivedHuman) -> tuple[float, float, float, float]:
        t = self._config.prediction_s
        return human.x_m, human.y_m, human.x_m + t * human.vx_mps, human.y_m + t * human.vy_mps

    def _is_due(self, step: int, near: list[PerceivedHuman]) -> bool:
        config = self._config
        elapsed_s = (step - self._planned_at_step) / RATE_HZ
        if elapsed_s < config.replan_interval_min_s - 1e-9:
            return False
        if self._plan is None or elapsed_s >= config.replan_period_s - 1e-9:
            return True
        ahead = self._tracker.progress + int(config.replan_lookahead_s * self._ground.robot.v_max_mps / 0.05) + 1
        return any(self._gap_m(human, ahead) < config.replan_distance_m for human in near)

    def _replan(self, simulation: EpisodeSimulation, near: list[PerceivedHuman]) -> None:
        """Search anew, with less and less margin; on failure the old plan stays."""
        self._planned_at_step = simulation.step
        for margin in _Margin if near else (_Margin.FULL, _Margin.CONTACT):
            plan = self._search(simulation, near, margin)
            if plan is not None:
                if not self._is_old_as_good(plan, simulation):
                    self._plan = plan
                    self._tracker.follow(plan, simulation.yaw_rad)
                return

    def _is_old_as_good(self, plan: Plan, simulation: EpisodeSimulation) -> bool:
        """True if the rest of the old plan is free on the latest map and hardly dearer; switching costs smoothness."""
        ground, tracker = self._ground, self._tracker
        if self._plan is None or tracker.turning or tracker.gap_m(simulation.x_m, simulation.y_m) > _OFF_PATH_M:
            return False
        new = np.column_stack([plan.xyyaw, plan.speed_mps])
        turn = plan.xyyaw[0, 2] - simulation.yaw_rad
        turn_m = self._config.turn_cost_m * abs((turn + math.pi) % (2 * math.pi) - math.pi)
        v_max = ground.robot.v_max_mps
        old_m = path_cost(tracker.path, tracker.progress, self._latest_factor, ground.frame, v_max)
        new_m = turn_m + path_cost(new, 0, self._latest_factor, ground.frame, v_max)
        return bool(old_m <= self._config.keep_ratio * new_m)

    def _search(self, simulation: EpisodeSimulation, near: list[PerceivedHuman], margin: _Margin) -> Plan | None:
        ground = self._ground
        pose = (simulation.x_m, simulation.y_m, simulation.yaw_rad)
        i, j = ground.frame.cell(pose[0], pose[1])
        factor, heuristic = ground.static_factor, self._static_heuristic
        if near or margin is not _Margin.FULL or factor[i, j] == 0:
            factor, heuristic = ground.factor, ground.heuristic
            factor[:] = ground.static_factor if margin is _Margin.FULL else ground.tight_factor
            # Whoever stands nearer to a wall than planned must be able to leave.
            tolerated_m = min(ground.robot.radius_m + self._config.tight_margin_m, ground.clearance[i, j] - 0.02)
            open_around(factor, ground.frame, ground.clearance, pose[:2], tolerated_m, self._config.dear_factor)
            for human in near:
                self._paint(factor, human, simulation.step, pose[:2], margin)
            slack = int(_HEURISTIC_SLACK_M / ground.frame.resolution_m * UNITS_PER_CELL)
            ground.search.distances(factor, self._goal_cell, target=(i, j), slack_units=slack, out=heuristic)
        if heuristic[i, j] >= UNREACHED:
            return None
        self._latest_factor = factor
        standing = simulation.v_mps < _STANDING_MPS
        return ground.hybrid.search(factor, heuristic, pose, self._goal, turn_first=standing)

    def _paint(
        self, factor: UInt8Array, human: PerceivedHuman, step: int, robot_m: tuple[float, float], margin: _Margin
    ) -> None:
        """Put a human into the map: blocked ground, dear around it and wherever the robot itself stands in it."""
        config, ground = self._config, self._ground
        ends = self._capsule(human)
        at = (human.x_m, human.y_m, human.x_m, human.y_m)
        here = np.array([robot_m])
        to_ends_m, to_human_m = path_distance(here, 0, 1, ends), path_distance(here, 0, 1, at)
        full_m = ground.robot.planning_radius_m + ground.human_radius_m + config.buffer_m
        contact_m = ground.contact_m + _CONTACT_GAP_M
        paint_slope(factor, ground.frame, ends, full_m, config.dear_factor)
        if margin is _Margin.FULL:
            reach_m = ground.robot.planning_radius_m + config.buffer_m
            points = self._footprint(human, step)
            to_points_m = math.sqrt(float(np.min(np.sum((points - here) ** 2, axis=1))))
            paint_capsule(factor, ground.frame, ends, min(full_m, to_ends_m - _START_GAP_M), 0)
            paint_points(factor, ground.frame, points, min(reach_m, to_points_m - _START_GAP_M), 0)
        elif margin is _Margin.CONTACT:
            paint_capsule(factor, ground.frame, ends, min(contact_m, to_ends_m - _START_GAP_M), 0)
        paint_capsule(factor, ground.frame, at, min(contact_m, to_human_m - _START_GAP_M), 0)

    def _footprint(self, human: PerceivedHuman, step: int) -> Float64Array:
        """Ground points of the posed avatar if it is seen now, else the point where it is expected."""
        if not human.seen:
            return np.array([[human.x_m, human.y_m]])
        who, avatar, model = self._people[human.index]
        return footprint_xy(model, avatar, who.motion, step)

    def _drive(self, simulation: EpisodeSimulation, humans: list[PerceivedHuman]) -> tuple[float, float]:
        state = (simulation.x_m, simulation.y_m, simulation.yaw_rad, simulation.v_mps, simulation.w_radps)
        watched = humans if self._config.yield_to_humans else []
        expected = [self._expected(simulation, human) for human in watched]
        expected_m = np.array(expected).reshape(-1, AHEAD_STEPS, 2)
        if self._plan is None:
            return self._tracker.turn(state, self._way_out(state), expected_m)
        return self._tracker.command(state, expected_m)

    def _expected(self, simulation: EpisodeSimulation, human: PerceivedHuman) -> Float64Array:
        """Where a human is expected in the next steps [m], shape (AHEAD_STEPS, 2)."""
        ahead = human.ahead(AHEAD_STEPS)
        known = min(round(self._config.foresight_s * RATE_HZ), AHEAD_STEPS) if human.seen else 0
        if known == 0:
            return ahead
        true = [simulation.human_xy_at(simulation.step + k)[human.index] for k in range(known + 1)]
        step = true[-1] - true[-2]
        beyond = [true[-1] + k * step for k in range(1, AHEAD_STEPS - known + 1)]
        return np.array(true[1:] + beyond)

    def _way_out(self, state: State) -> float:
        """Bearing of the reachable cell within 0.5 m that is nearest to the goal by the static heuristic [rad]."""
        ground = self._ground
        i, j = ground.frame.cell(state[0], state[1])
        reach = math.ceil(0.5 / ground.frame.resolution_m)
        i0, j0 = max(0, i - reach), max(0, j - reach)
        window = self._static_heuristic[i0 : i + reach + 1, j0 : j + reach + 1]
        if window.size == 0 or int(window.min()) >= UNREACHED:
            x, y = self._goal.tolist()
        else:
            best = int(np.argmin(window))
            x, y = ground.frame.centre_m(i0 + best // window.shape[1], j0 + best % window.shape[1])
        bearing = math.atan2(y - state[1], x - state[0]) - state[2]
        return (bearing + math.pi) % (2 * math.pi) - math.pi
