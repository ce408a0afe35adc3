"""Drives along a plan within the robot's limits; every command is tried out ahead before it is executed.

Pursuit with several look-ahead distances and speeds is simulated until the robot could stand. The first run that
keeps the disc off obstacles, and off visible humans at constant velocity, is taken. If a human leaves no such run,
the robot evades on the arc that keeps the widest gap.
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.ground import EpisodeGround
from readygo.services.planner.expert.hybrid_astar import Plan
from readygo.services.planner.expert.records import Limits, State, Surroundings, robot_limits
from readygo.services.planner.expert.rollouts import (
    EVASION_GAP_M,
    FREE_RUN,
    TRACKING_MARGIN_M,
    Pursuits,
    choose_evasion,
    choose_pursuit,
    limit_command,
    nearest_ahead,
    slow_ahead,
    try_arc,
)

_LOOKAHEADS_M = np.array([1.0, 0.7, 0.45, 0.3, 0.2])
"""Pursuit distances, the first that keeps the disc free is taken [m]."""
_YIELD_MARGIN_M = 0.15
"""Free space between robot and human that yielding aims at [m]."""
_DOUBT_MPS = 0.1
"""Growth of the predicted humans' radius with the time ahead [m/s]."""
_MOVING = np.array([1.0, 0.6, 0.3, 0.0])
_TURNED_RAD = 0.1
_NO_HUMANS = np.empty((0, 1, 2))


class PathTracker:
    """Follows one plan at a time; a new plan starts where the robot is."""

    def __init__(self, local: EpisodeGround, robot: RobotConfig, contact_m: float) -> None:
        """Prepare for one episode.

        Args:
            local: Map, clearance and way to the goal.
            robot: Footprint and limits.
            contact_m: Sum of the radii of robot and human [m].
        """
        self._obstacles, self._limits = local.obstacles, robot_limits(robot)
        self._to_goal = local.to_goal
        self._robot, self._contact_m = robot, contact_m
        self._lookahead_m = float(_LOOKAHEADS_M.min())
        self._turn_to_rad: float | None = None
        self.path = np.empty((0, 4))
        """x [m], y [m], yaw [rad], speed [m/s] of the plan's points, shape (N, 4); empty without a plan."""
        self.progress = 0
        """Index of the path's point that the robot has reached."""

    def follow(self, plan: Plan, yaw_rad: float) -> None:
        """Take a new plan, which may begin with a turn in place."""
        self.path = np.column_stack([plan.xyyaw, plan.speed_mps])
        slow_ahead(self.path, 0.9 * self._robot.a_max_mps2)
        self.progress = 0
        first_rad = float(plan.xyyaw[0, 2])
        self._turn_to_rad = first_rad if abs(_wrap_angle(first_rad - yaw_rad)) > 1e-6 else None

    def update(self, x_m: float, y_m: float) -> None:
        """Note where the robot is along the path."""
        self.progress = nearest_ahead(self.path, self.progress, x_m, y_m)

    @property
    def turning(self) -> bool:
        """True while the plan's first turn in place is not done."""
        return self._turn_to_rad is not None

    def gap_m(self, x_m: float, y_m: float) -> float:
        """Distance between the robot and its point on the path [m]."""
        x, y = self.path[self.progress, :2].tolist()
        return math.hypot(x - x_m, y - y_m)

    def command(self, state: State, humans: Float64Array = _NO_HUMANS, *, held_steps: int = 1) -> tuple[float, float]:
        """Command that follows the plan.

        Args:
            state: Robot's x [m], y [m], yaw [rad], v [m/s], w [rad/s].
            humans: Where humans are expected after 1, 2, ... steps: x, y [m], shape (M, T, 2).
            held_steps: Steps during which the command is held; each later one is held for the robot's control period.

        Returns:
            v [m/s], w [rad/s], reachable within the robot's limits while the command is held.
        """
        if self._turn_to_rad is not None:
            turn_rad = _wrap_angle(self._turn_to_rad - state[2])
            if abs(turn_rad) > _TURNED_RAD:
                return self.turn(state, turn_rad, humans, held_steps=held_steps)
            self._turn_to_rad = None
        pursuits = Pursuits(
            scales=_MOVING,
            lookaheads_m=_LOOKAHEADS_M,
            lookahead_max_m=self._lookahead_m * 1.15 + 0.01,
            margin_m=_YIELD_MARGIN_M,
        )
        around, limits = self._around(state, humans), self._limits._replace(held_steps=held_steps)
        found, v, w, lookahead_m = choose_pursuit(self.path, self.progress, state, pursuits, limits, around)
        self._lookahead_m = lookahead_m
        return (v, w) if found else self._evade(state, limits, humans, (v, w))

    def turn(
        self, state: State, turn_rad: float, humans: Float64Array = _NO_HUMANS, *, held_steps: int = 1
    ) -> tuple[float, float]:
        """Command that brakes and turns in place by `turn_rad`, unless a human comes too near; see `command`."""
        limits = self._limits._replace(held_steps=held_steps)
        # The rate w ends the turn without overshoot: what is left after the hold, turn - w t, is at least w^2 / (2 a).
        a_radps2 = 0.8 * self._robot.alpha_max_radps2
        held_radps = a_radps2 * (held_steps - 1) * limits.step_s
        rate = math.sqrt(held_radps**2 + 2 * a_radps2 * abs(turn_rad)) - held_radps
        w = math.copysign(min(rate, self._robot.w_max_radps), turn_rad)
        steps, gap, _ = try_arc(0.0, w, state, limits, self._around(state, humans), self._to_goal)
        command: tuple[float, float] = limit_command(0.0, w, state, limits, held_steps)
        if steps >= FREE_RUN and gap >= _YIELD_MARGIN_M:
            return command
        return self._evade(state, limits, humans, command)

    def _evade(
        self, state: State, limits: Limits, humans: Float64Array, otherwise: tuple[float, float]
    ) -> tuple[float, float]:
        if len(humans) == 0:
            return otherwise
        around = self._around(state, humans)
        found, v, w = choose_evasion(state, limits, around, EVASION_GAP_M, self._to_goal)
        return (v, w) if found else otherwise

    def _around(self, state: State, humans: Float64Array) -> Surroundings:
        return Surroundings(self._obstacles, self._radius_m(state), humans, self._contact_m, _DOUBT_MPS)

    def _radius_m(self, state: State) -> float:
        """Radius that runs keep free: the disc and a margin, unless the robot stands within the margin already."""
        wide_m = self._robot.radius_m + TRACKING_MARGIN_M
        close = self._meets(state, wide_m)
        return self._robot.radius_m + 0.1 * TRACKING_MARGIN_M if close else wide_m

    def _meets(self, state: State, radius_m: float) -> bool:
        occupied, _, ox, oy, resolution = self._obstacles
        return bool(disc_meets_cells(occupied, ox, oy, resolution, state[0], state[1], radius_m))


def _wrap_angle(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi
