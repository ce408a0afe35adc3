"""Motion primitives with acceleration: what a robot really drives in half a second, from one command to another.

Speeds and turn rates lie on levels that one primitive can bridge within the robot's limits, so that a chain of
primitives is a sequence of commands that the robot executes exactly.

Legend: (v, w) speed [m/s] and turn rate [rad/s]. A step of dt at (v, w) is an arc of radius v / w:

    x += v / w (sin(yaw + w dt) - sin yaw),   y -= v / w (cos(yaw + w dt) - cos yaw).

The cost of a primitive, in metres at full speed, is the mean of its length and of what full speed drives in its time,
and what steering, swerving, driving backwards and changing gear add.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.config import GEAR_COST_M, PRIMITIVE_S, REVERSE_COST
from readygo.services.planner.expert.primitive_cost import CHECK_STEPS
from readygo.services.planner.expert.records import Limits, State, robot_limits
from readygo.services.planner.expert.rollouts import limit_command

_STEERING_COST = 0.15
"""Cost of full turning for a second, as a share of full speed."""
_SWERVE_COST = 0.1
"""Cost of changing the turn rate by its maximum, as a share of full speed."""


class PrimitiveTable(NamedTuple):
    """Primitives in groups by the levels of speed and turn rate that they start at."""

    rows: Float64Array
    """x [m], y [m], yaw [rad] relative to the start, v [m/s], w [rad/s] after each step, shape (Q, K, 5)."""
    costs: Float64Array
    """Cost of each primitive, in metres at full speed, shape (Q,)."""
    lengths_m: Float64Array
    """Length of each primitive, shape (Q,)."""
    ends: Int32Array
    """The group that may follow each primitive, shape (Q,)."""
    first: Int32Array
    """First primitive of each group, shape (G + 1,); the last group is the root's, filled for every search."""


class PrimitiveRules(NamedTuple):
    """What primitives are made by."""

    v_levels: Float64Array
    w_levels: Float64Array
    limits: Limits


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedPrimitives:
    """Primitives of one robot."""

    table: PrimitiveTable
    rules: PrimitiveRules

    @property
    def steps(self) -> int:
        """Steps of a primitive, K."""
        return int(self.table.rows.shape[1])

    @property
    def turn_level_count(self) -> int:
        """How many levels the turn rate has; groups count through them first."""
        return len(self.rules.w_levels)

    def fill_root(self, v_mps: float, w_radps: float) -> None:
        """Fill the root's group with the primitives that start at any command."""
        root = len(self.table.first) - 2
        count = _fill_group(v_mps, w_radps, self.rules, int(self.table.first[root]), self.table)
        self.table.first[root + 1] = self.table.first[root] + count


def make_timed_primitives(robot: RobotConfig) -> TimedPrimitives:
    """Tabulate the primitives of a robot."""
    steps = _steps(robot)
    duration_s = steps * robot.clock.dt_s
    v_count = math.ceil(robot.v_max_mps / (robot.a_max_mps2 * duration_s) - 1e-9)
    back_count = math.ceil(-robot.v_min_mps / (robot.a_max_mps2 * duration_s) - 1e-9)
    backwards = [robot.v_min_mps * k / back_count for k in range(back_count, 0, -1)]
    w_count = max(2, math.ceil(robot.w_max_radps / (robot.alpha_max_radps2 * duration_s) - 1e-9))
    rules = PrimitiveRules(
        v_levels=np.array([*backwards, *(robot.v_max_mps * k / v_count for k in range(v_count + 1))]),
        w_levels=np.array([robot.w_max_radps * k / w_count for k in range(-w_count, w_count + 1)]),
        limits=robot_limits(robot),
    )
    turn_levels = len(rules.w_levels)
    groups = len(rules.v_levels) * turn_levels
    capacity = (groups + 1) * groups
    table = PrimitiveTable(
        rows=np.zeros((capacity, steps, 5)),
        costs=np.zeros(capacity),
        lengths_m=np.zeros(capacity),
        ends=np.zeros(capacity, np.int32),
        first=np.zeros(groups + 2, np.int32),
    )
    for group in range(groups):
        v, w = float(rules.v_levels[group // turn_levels]), float(rules.w_levels[group % turn_levels])
        begin = int(table.first[group])
        table.first[group + 1] = begin + _fill_group(v, w, rules, begin, table)
    return TimedPrimitives(table=table, rules=rules)


def _steps(robot: RobotConfig) -> int:
    """Steps of a primitive: whole commands and whole checks."""
    block = math.lcm(CHECK_STEPS, robot.clock.control_every)
    return block * max(1, round(PRIMITIVE_S * robot.clock.rate_hz / block))


@kernel_with_cache
def _drive(
    v: float, w: float, v_end: float, w_end: float, limits: Limits, rows: Float64Array
) -> tuple[float, float, float]:
    """Fill the rows of one primitive by exact arcs; returns length and way backwards [m], and turning [rad]."""
    x, y, yaw, length, back, turned = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    dt = limits.step_s
    for k in range(len(rows)):
        v, w = limit_command(v_end, w_end, State(x, y, yaw, v, w), limits)
        after = yaw + w * dt
        if abs(w) < 1e-9:
            x += v * dt * math.cos(yaw)
            y += v * dt * math.sin(yaw)
        else:
            x += v / w * (math.sin(after) - math.sin(yaw))
            y -= v / w * (math.cos(after) - math.cos(yaw))
        yaw = after
        length += abs(v) * dt
        back += max(-v, 0.0) * dt
        turned += abs(w) * dt
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4] = x, y, yaw, v, w
    return length, back, turned


@kernel_with_cache
def _fill_group(v: float, w: float, rules: PrimitiveRules, begin: int, table: PrimitiveTable) -> int:
    """Tabulate what leads from a command to all levels within reach, from index `begin` on; returns its number."""
    v_levels, w_levels, limits = rules
    rows, costs, lengths, ends, _ = table
    v_max, w_max, a_max, alpha_max, _, step_s, _, _ = limits
    duration = rows.shape[1] * step_s
    count = 0
    for a in range(len(v_levels)):
        for b in range(len(w_levels)):
            if abs(v_levels[a] - v) > a_max * duration + 1e-6 or abs(w_levels[b] - w) > alpha_max * duration + 1e-6:
                continue
            q = begin + count
            lengths[q], back, turned = _drive(v, w, v_levels[a], w_levels[b], limits, rows[q])
            # (length + duration v_max) / 2 + v_max (steering |turned| + swerving |change of w|) / w_max.
            costs[q] = 0.5 * (lengths[q] + duration * v_max)
            costs[q] += v_max * (_STEERING_COST * turned + _SWERVE_COST * abs(w_levels[b] - w)) / w_max
            if v_levels[a] < 0.0 or v < 0.0:
                costs[q] += REVERSE_COST * back
                if (v_levels[a] < 0.0) != (v < 0.0) and v_levels[a] != 0.0:
                    costs[q] += GEAR_COST_M
            ends[q] = a * len(w_levels) + b
            count += 1
    return count
