"""The expert that plans in space and time: it waits, turns in place, goes around, or slips through."""

import math
import time
from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.grid_search import FREE
from readygo.common.messages import EpisodeMotions, Scenario
from readygo.services.planner.expert.config import ExpertConfig
from readygo.services.planner.expert.cost_factors import open_around, paint_capsule, paint_slope
from readygo.services.planner.expert.ground import HIGH_FACTOR, EpisodeGround, SceneGround
from readygo.services.planner.expert.interface import Decision, expected_array
from readygo.services.planner.expert.perception import HumanTracks, PeopleSource, PerceivedHuman, stands
from readygo.services.planner.expert.records import HumansAhead, State, Surroundings, robot_limits, state_of
from readygo.services.planner.expert.rollouts import (
    AHEAD_S,
    EVASION_GAP_M,
    TRACKING_MARGIN_M,
    choose_evasion,
    turn_rate,
)
from readygo.services.planner.expert.spacetime_search import SpaceTimeSearch, TimedPlan

_PREDICTION_S, _ORACLE_PREDICTION_S = 4.0, 8.0
"""Times that humans are predicted ahead, and that an oracle knows them ahead [s]."""
_REPLAN_S, _IDLE_REPLAN_S = 0.25, 1.0
"""Times after which a plan is renewed, while humans are known and while none are [s]."""
_HARD_MARGIN_M = 0.03
"""Smaller gaps between robot and expected human count as contact [m]."""
_MARGIN_M = 0.4
"""Free space beyond contact that costs nothing [m]."""
_DOUBT_GROWTH_MPS, _DOUBT_MAX_M = 0.2, 0.6
"""Growth of this space with the time ahead [m/s], and its largest growth [m]."""
_DOUBT_SHARE = 0.5
"""Share of the deviation of a tracked human's place that this space grows by."""
NEARNESS_COST = 30.0
"""Cost of a second without this space, in metres at full speed; falls off with its square."""
_CHANCE_GAIN = 2.0
"""Factor on chances up to 1: what is half likely is avoided like what is certain."""
_STANDING_MARGIN_M = 0.5
"""Ground this near to contact with a human who stands costs twice as much [m]."""
_STANDING_WIDTH_M = 0.02
_START_GAP_M = 0.03
_OFF_PLAN = 1e-3
"""A robot that is further from where its plan has it, in metres, radians or their speeds, does not follow the plan;
one that does is there but for rounding."""


def horizon_s(config: ExpertConfig) -> float:
    """Longest time that plans reach ahead, and that humans are predicted [s]."""
    return _ORACLE_PREDICTION_S if config.oracle else _PREDICTION_S


class SpaceTimeExpert:
    """Drives one episode in mode "spacetime"; call `act` at every step."""

    def __init__(
        self,
        ground: SceneGround,
        search: SpaceTimeSearch,
        scenario: Scenario,
        motions: EpisodeMotions,
        find_people: Callable[[EpisodeGround, int], PeopleSource] | None = None,
    ) -> None:
        """Prepare the static way to the goal.

        Args:
            ground: What all episodes in the scene share.
            search: Searches, shared by all episodes.
            scenario: Start and goal.
            motions: How the humans move, in the order of the scenario.
            find_people: Makes what tells it of people, of the episode's part of the map and the steps to look ahead;
                None sees those in view as they are.
        """
        config = ground.config
        self._ground, self._search, self._config = ground, search, config
        self._goal_m = (float(scenario.goal_xy_m[0]), float(scenario.goal_xy_m[1]))
        self._local = ground.around((float(scenario.start_xyyaw[0]), float(scenario.start_xyyaw[1])), self._goal_m)
        self._clock = ground.robot.clock
        self._horizon = self._clock.steps(horizon_s(config))
        paths_m = [human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans]
        self._tracks: PeopleSource = (
            HumanTracks(ground, self._local, paths_m, self._horizon)
            if find_people is None
            else find_people(self._local, self._horizon)
        )
        self._contact_m = ground.contact_m + _HARD_MARGIN_M
        self._limits = robot_limits(ground.robot)
        self._plan: TimedPlan | None = None
        self._widened = False
        self._planned_at_step = 0
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
        pose = state_of(simulation)[:3]
        return any(human.seen for human in self._tracks.observe(simulation.step, pose, simulation.human_xy_m))

    def _decide(self, simulation: EpisodeSimulation) -> Decision:
        state = state_of(simulation)
        if not self._local.holds(state[0], state[1]):
            self._local = self._tracks.local = self._ground.around(state[:2], self._goal_m)
        humans = self._tracks.observe(simulation.step, state[:3], simulation.human_xy_m)
        replanned = self._is_due(simulation.step, state, humans)
        if replanned:
            started_s = time.thread_time()
            self._replan(simulation.step, state, humans)
            self.replan_times_s.append(time.thread_time() - started_s)
        v, w = self._drive(simulation.step, state, humans)
        rows = np.empty((0, 5)) if self._plan is None else self._plan.rows[simulation.step - self._planned_at_step :]
        return Decision(
            v_mps=v,
            w_radps=w,
            replanned=replanned,
            cost=0.0 if self._plan is None else self._plan.cost,
            visible=any(human.seen for human in humans),
            commands=np.array([(v, w)]) if len(rows) < 2 else rows[1:, 3:5],
            path_xy_m=rows[:, :2],
            perceived=tuple(humans),
        )

    def _is_due(self, step: int, state: State, humans: list[PerceivedHuman]) -> bool:
        elapsed = step - self._planned_at_step
        if self._plan is None or elapsed >= len(self._plan.rows):
            return True
        if _is_off(state, self._plan.rows[elapsed]):
            return True
        if not self._clock.commands(step):
            return False
        period_s = _REPLAN_S if humans else _IDLE_REPLAN_S
        return elapsed >= len(self._plan.rows) - 1 or elapsed * self._clock.dt_s >= period_s - 1e-9

    def _replan(self, step: int, state: State, humans: list[PerceivedHuman]) -> None:
        self._planned_at_step = step
        standing = [human for human in humans if stands(human.vx_mps, human.vy_mps)]
        factor, heuristic = self._local.tight_factor, self._local.to_goal
        if standing or factor[self._local.frame.cell(state[0], state[1])] == 0:
            # If no path leads around standing humans, they may walk on.
            leads_around = self._finds_way(self._local, state, standing) or self._widens(state, standing)
            factor = self._local.factor
            heuristic = self._local.heuristic if leads_around else self._local.to_goal
        ahead = self._ahead(humans)
        self._plan = self._search.search(factor, heuristic, self._local.obstacles, state, self._goal_m, ahead)

    def _widens(self, state: State, standing: list[PerceivedHuman]) -> bool:
        """True if a larger window holds a way, which is tried once in an episode: it is slow and seldom helps."""
        wider = None if self._widened else self._ground.wider(self._local, state[:2], self._goal_m)
        self._widened = True
        if wider is None or not self._finds_way(wider, state, standing):
            return False
        self._local = self._tracks.local = wider
        return True

    def _finds_way(self, local: EpisodeGround, state: State, standing: list[PerceivedHuman]) -> bool:
        """Fill a window's factors and distances; False if no way leads around the humans who stand."""
        self._paint(local, state, standing)
        return local.distances(local.factor, state[0], state[1])

    def _paint(self, local: EpisodeGround, state: State, standing: list[PerceivedHuman]) -> None:
        """Fill the factors of a window with standing humans in it, passable where the robot is."""
        factor = local.factor
        factor[:] = local.tight_factor
        radius_m = self._ground.robot.radius_m
        open_around(factor, local.frame, local.clearance, state[:2], radius_m, HIGH_FACTOR)
        for human in standing:
            ends = (human.x_m, human.y_m, human.x_m, human.y_m)
            gap_m = math.hypot(human.x_m - state[0], human.y_m - state[1]) - _START_GAP_M
            paint_slope(factor, local.frame, ends, self._contact_m + _STANDING_MARGIN_M, 2 * FREE)
            paint_capsule(factor, local.frame, ends, min(self._contact_m, gap_m), 0)

    def _ahead(self, humans: list[PerceivedHuman]) -> HumansAhead:
        """All that the humans may do, by chance."""
        rows, chances, widths = [], [], []
        for human in humans:
            walks_m, likely = human.find_walks()
            rows += [*walks_m]
            chances += likely.tolist()
            widths += [self._widths(human)] * len(likely)
        return HumansAhead(
            expected_m=np.array(rows).reshape(-1, self._horizon, 2),
            chances=np.minimum(1.0, _CHANCE_GAIN * np.array(chances)),
            contact_m=self._contact_m,
            widths_m=np.array(widths).reshape(-1, self._horizon),
            weight=NEARNESS_COST,
            step_s=self._clock.dt_s,
        )

    def _widths(self, human: PerceivedHuman) -> Float64Array:
        """Free space around a human that costs nothing, in the next steps [m]."""
        if stands(human.vx_mps, human.vy_mps):
            return np.full(self._horizon, _STANDING_WIDTH_M)
        growth = 0.0 if self._config.oracle else _DOUBT_GROWTH_MPS
        ahead_s = np.arange(1, self._horizon + 1) * self._clock.dt_s + human.age_s
        doubt_m = human.deviation_m + np.minimum(human.deviation_mps * ahead_s, _DOUBT_MAX_M)
        widths: Float64Array = _MARGIN_M + _DOUBT_SHARE * doubt_m + np.minimum(growth * ahead_s, _DOUBT_MAX_M)
        return widths

    def _drive(self, step: int, state: State, humans: list[PerceivedHuman]) -> tuple[float, float]:
        if self._plan is not None:
            # A command is held: it is the one that the plan has at the end of that.
            ahead = step - self._planned_at_step + self._clock.held_for(step)
            row = self._plan.rows[min(ahead, len(self._plan.rows) - 1)]
            return float(row[3]), float(row[4])
        if humans:
            around = Surroundings(
                obstacles=self._local.obstacles,
                radius_m=self._ground.robot.radius_m + TRACKING_MARGIN_M,
                humans_m=expected_array(humans, self._clock.steps(AHEAD_S)),
                contact_m=self._ground.contact_m,
                doubt_mps=0.0,
            )
            limits = self._limits._replace(held_steps=self._clock.held_for(step))
            found, v, w = choose_evasion(state, limits, around, EVASION_GAP_M, self._local.to_goal)
            if found:
                return v, w
        turn_rad = self._local.way_out_rad(state[0], state[1], state[2], self._goal_m)
        return 0.0, turn_rate(turn_rad, self._clock.held_for(step) * self._clock.dt_s)


def _is_off(state: State, row: Float64Array) -> bool:
    """True if a robot is not where a row of a plan has it."""
    x, y, yaw, v, w = row.tolist()
    apart = (state[0] - x, state[1] - y, math.remainder(state[2] - yaw, math.tau), state[3] - v, state[4] - w)
    return bool(max(map(abs, apart)) > _OFF_PLAN)
