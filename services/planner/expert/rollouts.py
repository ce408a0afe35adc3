"""Runs of the robot a few seconds ahead, to try a command before it is executed.

Steering law: Coulter, Implementation of the pure pursuit path tracking algorithm, CMU-RI-TR-92-01. Evasion: Fox,
Burgard and Thrun, The dynamic window approach to collision avoidance, IEEE RAM 4 (1997).

Legend: a state is x, y [m], yaw [rad], v [m/s], w [rad/s]; rows of a path are x, y, yaw, speed, negative backwards.
Pure pursuit: with the target at (ahead, left) in the robot's axes, the arc through it that begins along the heading has
the curvature 2 left / (ahead^2 + left^2), and w = v * curvature. A command is held for h steps of dt; beyond_s is the
time of all of them but the first, (h - 1) dt.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.episode.grid_search import UNITS_PER_CELL, UNREACHED
from readygo.common.kernels import kernel_with_cache
from readygo.services.planner.expert.primitive_cost import HALF_DIAGONAL
from readygo.services.planner.expert.records import Limits, Obstacles, State, Surroundings

FREE_RUN = 1 << 20
"""Steps of a run that meets no obstacle."""

_TURN_FIRST_RAD = 1.2
AHEAD_S = 2.0
"""How far ahead runs look where humans are, and predictions must reach [s]."""
_SPARE_S = 0.45
"""Time that runs have beyond the robot's coming to rest [s]."""
_CREEP_MPS = 0.15
"""Speed at which a path is left for a stretch that leads the other way [m/s]."""
_ARRIVED_M = 0.08
"""So near its end has the robot done such a stretch [m]."""
_SQUARED_MIN_M2 = 0.04
"""Targets count as at least 0.2 m away, which bounds the curvature."""
_TURN_GAIN_PER_S = 2.0
"""Turn rate in place per angle that is left to turn [1/s]."""
_HELD_WAYS = 2.0
"""Look-ahead of a held command, in ways that the robot drives meanwhile; from one on, pursuit oscillates."""
_OVERLAP_M = 0.3
"""Added to the overlap with a human of an evasion, of which every metre costs 20 [m]."""
TRACKING_MARGIN_M = 0.01
"""Free space around the disc that runs and plans keep [m]."""
EVASION_GAP_M = 0.4
"""Free space that evading aims at [m]."""


@kernel_with_cache
def slow_ahead(path: Float64Array, deceleration_mps2: float) -> None:
    """Lower the speeds (fourth column) of a path so that slower stretches ahead are reached in time."""
    for k in range(len(path) - 2, -1, -1):
        gap = math.sqrt((path[k + 1, 0] - path[k, 0]) ** 2 + (path[k + 1, 1] - path[k, 1]) ** 2)
        after = _CREEP_MPS if path[k, 3] * path[k + 1, 3] < 0 else path[k + 1, 3]
        # v^2 = v_after^2 + 2 deceleration * gap.
        most = math.sqrt(after**2 + 2 * deceleration_mps2 * gap)
        path[k, 3] = max(min(path[k, 3], most), -most)


@kernel_with_cache
def nearest_ahead(path: Float64Array, progress: int, x: float, y: float) -> int:
    """Index of the path's point nearest to (x, y), from `progress` on and not far ahead.

    A stretch that leads the other way is begun where the one before it ends.
    """
    best, found = np.inf, progress
    for k in range(progress, min(progress + 16, len(path))):
        if k > 0 and path[k, 3] * path[k - 1, 3] < 0 and k > progress:
            if (path[k - 1, 0] - x) ** 2 + (path[k - 1, 1] - y) ** 2 > _ARRIVED_M * _ARRIVED_M:
                break
            best = np.inf
        squared = (path[k, 0] - x) ** 2 + (path[k, 1] - y) ** 2
        if squared < best:
            best, found = squared, k
    return found


@kernel_with_cache
def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@kernel_with_cache
def limit_command(v: float, w: float, state: State, limits: Limits, steps: int = 1) -> tuple[float, float]:
    """The command that the robot executes when (v, w) is asked for: what it reaches within some steps."""
    v_max, w_max, a_max, alpha_max, v_min, step_s, _, _ = limits
    dt = steps * step_s
    return (
        _clip(_clip(v, v_min, v_max), state[3] - a_max * dt, state[3] + a_max * dt),
        _clip(_clip(w, -w_max, w_max), state[4] - alpha_max * dt, state[4] + alpha_max * dt),
    )


@kernel_with_cache
def turn_rate(angle: float, held_s: float) -> float:
    """Turn rate in place towards a heading that is away by an angle, for a command that is held for `held_s`."""
    return min(_TURN_GAIN_PER_S, 1.0 / held_s) * angle


@kernel_with_cache
def _slow_for_hold(path: Float64Array, progress: int, speed: float, beyond_s: float) -> float:
    """At most `speed`, so that a held command drives over no slower stretch of the path too fast."""
    gear = -1.0 if path[progress, 3] < 0 else 1.0
    for k in range(progress + 1, len(path)):
        way = math.sqrt((path[k, 0] - path[progress, 0]) ** 2 + (path[k, 1] - path[progress, 1]) ** 2)
        if way >= speed * beyond_s or gear * path[k, 3] < 0:
            break
        speed = min(speed, max(abs(path[k, 3]), way / beyond_s))
    return speed


@kernel_with_cache
def _mean_speed(v: float, state: State, limits: Limits, held: int) -> float:
    """Mean speed while a command to drive at `v` is held."""
    now, way = state[3], 0.0
    change = limits.a_max_mps2 * limits.step_s
    for _ in range(held):
        now = _clip(v, now - change, now + change)
        way += now
    return way / held


@kernel_with_cache
def _pursue(
    path: Float64Array, progress: int, state: State, lookahead: float, scale: float, limits: Limits, held: int
) -> tuple[float, float]:
    """Command of pursuit that is held for some steps, within what the robot reaches in them."""
    x, y, yaw, _, _ = state
    w_max = limits[1]
    target = len(path) - 1
    gear = -1.0 if path[progress, 3] < 0 else 1.0
    wanted = scale * path[progress, 3]
    if held > 1:
        beyond_s = (held - 1) * limits.step_s
        wanted = gear * _slow_for_hold(path, progress, abs(wanted), beyond_s)
        lookahead = max(lookahead, _HELD_WAYS * beyond_s * abs(_mean_speed(wanted, state, limits, held)))
    # The target: the first point beyond the look-ahead, or the last one of this gear.
    for k in range(progress, len(path)):
        if gear * path[k, 3] < 0:
            target = k - 1
            break
        if (path[k, 0] - x) ** 2 + (path[k, 1] - y) ** 2 >= lookahead * lookahead:
            target = k
            break
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy = path[target, 0] - x, path[target, 1] - y
    ahead, left = c * dx + s * dy, c * dy - s * dx
    bearing = math.atan2(gear * left, gear * ahead)
    curvature = 2 * left / max(ahead * ahead + left * left, _SQUARED_MIN_M2)
    if abs(bearing) > _TURN_FIRST_RAD:
        wanted = 0.0
    elif abs(curvature) > 1e-6:
        # Slowly enough for |w| = |v curvature| to stay below its limit.
        wanted = gear * min(abs(wanted), 0.95 * w_max / abs(curvature))
    v, _ = limit_command(wanted, 0.0, state, limits, held)
    # At rest the robot turns towards the path; while it drives, it steers along the arc to the target.
    if abs(wanted) < 0.05:
        turning = turn_rate(bearing, held * limits.step_s)
    else:
        turning = _mean_speed(v, state, limits, held) * curvature
    return limit_command(wanted, turning, state, limits, held)


@kernel_with_cache
def _step(state: State, v: float, w: float, dt: float) -> State:
    """The state after one step of `dt`; the chord replaces the arc, which differs by less than 0.1 mm."""
    x, y, yaw, _, _ = state
    middle = yaw + 0.5 * w * dt
    return State(x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), yaw + w * dt, v, w)


@kernel_with_cache
def meets(state: State, obstacles: Obstacles, radius: float) -> bool:
    """True if a disc at a state meets an obstacle."""
    occupied, clearance, ox, oy, resolution = obstacles
    i, j = math.floor((state[1] - oy) / resolution), math.floor((state[0] - ox) / resolution)
    if (
        0 <= i < occupied.shape[0]
        and 0 <= j < occupied.shape[1]
        and clearance[i, j] > radius + HALF_DIAGONAL * resolution
    ):
        return False
    return disc_meets_cells(occupied, ox, oy, resolution, state[0], state[1], radius)


@kernel_with_cache
def _gap(state: State, around: Surroundings, k: int, dt: float) -> float:
    """Free space to the nearest human k + 1 steps ahead, less the doubt about where they are [m]."""
    _, _, humans, contact, doubt = around
    gap = np.inf
    row = min(k, humans.shape[1] - 1)
    for m in range(humans.shape[0]):
        dx, dy = humans[m, row, 0] - state[0], humans[m, row, 1] - state[1]
        gap = min(gap, math.sqrt(dx * dx + dy * dy) - contact - doubt * (k + 1) * dt)
    return gap


@kernel_with_cache
def _stop_steps(speed: float, limits: Limits) -> int:
    """Steps within which the robot could come to rest after the command that is held now, and some to spare."""
    beyond = limits.held_steps - 1
    reached = max(speed, min(limits.v_max_mps, speed + limits.a_max_mps2 * beyond * limits.step_s))
    return int(reached / (limits.a_max_mps2 * limits.step_s)) + int(_SPARE_S / limits.step_s + 0.5) + beyond


@kernel_with_cache
def _ahead_steps(limits: Limits) -> int:
    return int(AHEAD_S / limits.step_s + 0.5)


@kernel_with_cache
def try_pursuit(
    path: Float64Array,
    progress: int,
    state: State,
    lookahead: float,
    scale: float,
    limits: Limits,
    around: Surroundings,
) -> tuple[int, float, float, float]:
    """Follow a path by held commands.

    Returns:
        Steps until the disc meets an obstacle, smallest gap to a human, first command.
    """
    first_v, first_w, gap = 0.0, 0.0, np.inf
    asked_v, asked_w, due = 0.0, 0.0, 0
    stop_steps = _stop_steps(abs(state[3]), limits)
    steps = max(stop_steps, _ahead_steps(limits)) if len(around.humans_m) > 0 else stop_steps
    for k in range(steps):
        progress = nearest_ahead(path, progress, state[0], state[1])
        if k == due:
            held = limits.held_steps if k == 0 else limits.period_steps
            asked_v, asked_w = _pursue(path, progress, state, lookahead, scale, limits, held)
            due += held
        if k == 0:
            first_v, first_w = asked_v, asked_w
        v, w = limit_command(asked_v, asked_w, state, limits)
        state = _step(state, v, w, limits.step_s)
        if k < stop_steps and meets(state, around.obstacles, around.radius_m):
            return k, gap, first_v, first_w
        gap = min(gap, _gap(state, around, k, limits.step_s))
    return FREE_RUN, gap, first_v, first_w


@kernel_with_cache
def try_arc(
    v: float, w: float, state: State, limits: Limits, around: Surroundings, to_goal: Int32Array
) -> tuple[int, float, float]:
    """Keep asking for (v, w); returns steps until an obstacle, smallest gap, smallest distance to the goal [m]."""
    gap, goal_units = np.inf, UNREACHED
    _, _, ox, oy, resolution = around.obstacles
    stop_steps = _stop_steps(max(abs(state[3]), abs(v)), limits)
    for k in range(max(stop_steps, _ahead_steps(limits))):
        command = limit_command(v, w, state, limits)
        state = _step(state, command[0], command[1], limits.step_s)
        if k < stop_steps and meets(state, around.obstacles, around.radius_m):
            return k, gap, np.inf
        gap = min(gap, _gap(state, around, k, limits.step_s))
        i, j = math.floor((state[1] - oy) / resolution), math.floor((state[0] - ox) / resolution)
        if 0 <= i < to_goal.shape[0] and 0 <= j < to_goal.shape[1]:
            goal_units = min(goal_units, to_goal[i, j])
    return FREE_RUN, gap, goal_units * resolution / UNITS_PER_CELL


class Pursuits(NamedTuple):
    """The runs along a path that are tried, in this order."""

    scales: Float64Array
    """Shares of the path's speed; the first is tried with every look-ahead."""
    lookaheads_m: Float64Array
    lookahead_max_m: float
    """Longer ones are tried with this."""
    margin_m: float
    """Free space to humans that ends the trials [m]."""


@kernel_with_cache
def choose_pursuit(
    path: Float64Array, progress: int, state: State, pursuits: Pursuits, limits: Limits, around: Surroundings
) -> tuple[bool, float, float, float]:
    """The first run that keeps off obstacles and humans, else the longest: (found, v, w, look-ahead)."""
    scales, lookaheads, lookahead_max, margin = pursuits
    best = -1
    v, w, chosen = 0.0, 0.0, lookaheads[0]
    for scale in scales:
        for lookahead in lookaheads:
            tried = min(lookahead, lookahead_max)
            steps, gap, first_v, first_w = try_pursuit(path, progress, state, tried, scale, limits, around)
            if steps >= FREE_RUN and gap >= margin:
                return True, first_v, first_w, tried
            if steps > best:
                best, v, w, chosen = steps, first_v, first_w, tried
    return False, v, w, chosen


@kernel_with_cache
def choose_evasion(
    state: State, limits: Limits, around: Surroundings, wide: float, to_goal: Int32Array
) -> tuple[bool, float, float]:
    """The arc that keeps off obstacles and scores best by gap to humans and way to the goal: (found, v, w).

    v and w are what the robot reaches on it while the command is held. Gaps from `wide` [m] on are all the same.
    """
    best, found, best_v, best_w = -np.inf, False, 0.0, 0.0
    for a in range(-2 if limits.v_min_mps < 0 else 0, 5):
        v = limits[0] * a / 4 if a >= 0 else -limits.v_min_mps * a / 2
        for b in range(-4, 5):
            w = limits[1] * b / 4
            steps, gap, to_go = try_arc(v, w, state, limits, around, to_goal)
            if steps < FREE_RUN:
                continue
            # Way to the goal, change of turning, and humans nearer than `wide`.
            score = -min(to_go, 1e3) - 0.1 * abs(w - state[4]) / limits[1]
            if gap < wide:
                score -= 4.0 * (wide - gap) / wide
            if gap < 0:
                score -= 20.0 * (_OVERLAP_M - gap)
            if score > best:
                best, found, best_v, best_w = score, True, v, w
    v, w = limit_command(best_v, best_w, state, limits, limits.held_steps)
    return found, v, w
