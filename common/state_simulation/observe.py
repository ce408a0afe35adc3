"""What a robot is told, as numbers of order 1: free distances, goal, path, speeds, tracked people; and the truth.

| columns | what a robot is told |
|---|---|
| 0 .. 31 | exp(-d / 2 m) of the free distance d in each direction |
| 32 .. 36 | goal in the robot's frame: x / 10 m, y / 10 m, its direction, exp(-distance / 2 m) |
| 37, 38 | v [m/s], w [rad/s] |
| 39 .. 44 | shortest path to the goal: length / 10 m, exp(-length / 2 m), directions 0.6 m and 1.6 m ahead |
| from 45 | for each told person, the nearest first, the `PERSON_COUNT` numbers of `_tell_person` |
| then | for each arc: time to an obstacle, smallest distance to the tracked people and its time, see `_tell_arc` |

The critic is told `truth`: the same, and what only the simulation knows.
"""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, UInt16Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import limit_command, step_unicycle
from readygo.common.state_simulation.goal_distances import point_ahead, remaining_m
from readygo.common.state_simulation.tracks import TrackerNumbers, Tracks, is_visible
from readygo.common.state_simulation.world import RAY_COUNT, RAY_M, StateWorld

GOAL, SPEED, PATH, PEOPLE = RAY_COUNT, RAY_COUNT + 5, RAY_COUNT + 7, RAY_COUNT + 13
"""First columns of goal, speeds, path and people."""
PERSON_COUNT = 18
"""Numbers per told person."""
_NEAR_CELLS, _FAR_CELLS = 6, 16
_AHEAD_S = (0.0, 0.5, 1.0, 2.0, 3.0)
"""Times at which the truth has people's places [s]."""
_HUMAN_TRUTH = 3 * len(_AHEAD_S)
_TRUTH = 3
_WALK_RAD, _WALK_M = 0.6, 4.0
"""Free distances before a person: to both sides of the direction of walking [rad], and the longest one told [m]."""
_CLOSEST_S = 4.0
ARC_COUNT = 3
"""Numbers per arc."""
_ARC_STEP_S, _ARC_STEPS = 0.25, 12
_limit_command: Any = kernel_with_cache(limit_command)
_step_unicycle = kernel_with_cache(step_unicycle)


def told_count(world: StateWorld) -> int:
    """Numbers that a robot is told."""
    return PEOPLE + world.told_people * PERSON_COUNT + len(world.arcs) * ARC_COUNT


def truth_count(world: StateWorld, human_count: int) -> int:
    """Numbers that the critic is told, with at most so many people in an episode."""
    return told_count(world) + _TRUTH + human_count * _HUMAN_TRUTH


@kernel_with_cache
def free_distance_m(world: StateWorld, x_m: float, y_m: float, bearing_rad: float, longest_m: float) -> float:
    """Distance from a point to the first occupied cell in a direction [m], in strides that the clearance allows."""
    clearance, (origin_x, origin_y, cell) = world.clearance_m, world.place
    c, s, d = math.cos(bearing_rad), math.sin(bearing_rad), 0.0
    while d < longest_m:
        i, j = math.floor((y_m + s * d - origin_y) / cell), math.floor((x_m + c * d - origin_x) / cell)
        if i < 0 or j < 0 or i >= clearance.shape[0] or j >= clearance.shape[1] or clearance[i, j] <= 0.0:
            return d
        d += max(clearance[i, j] - 0.71 * cell, 0.5 * cell)
    return longest_m


@kernel_with_cache
def observe(
    world: StateWorld,
    numbers: TrackerNumbers,
    tracks: Tracks,
    n: int,
    step: int,
    state: tuple[float, float, float, float, float],
    goal_xy_m: tuple[float, float],
    field_cm: UInt16Array,
    out: Float32Array,
) -> None:
    """Write what a robot is told.

    Args:
        world: Map and cameras.
        numbers: The perception's numbers.
        tracks: Trackers.
        n: The robot.
        step: Steps since its episode began.
        state: Robot's x, y [m], yaw [rad], v [m/s], w [rad/s].
        goal_xy_m: Goal in the world [m].
        field_cm: Remaining distances, see `GoalDistances`.
        out: To fill, shape (told_count,).
    """
    x, y, yaw, v, w = state
    c, s = math.cos(yaw), math.sin(yaw)
    out[:] = 0.0
    for k in range(RAY_COUNT):
        out[k] = math.exp(-0.5 * free_distance_m(world, x, y, yaw + world.bearings_rad[k], RAY_M))
    gx, gy = goal_xy_m[0] - x, goal_xy_m[1] - y
    away = max(math.sqrt(gx * gx + gy * gy), 1e-6)
    ahead, left = c * gx + s * gy, c * gy - s * gx
    out[GOAL], out[GOAL + 1] = ahead / 10.0, left / 10.0
    out[GOAL + 2], out[GOAL + 3], out[GOAL + 4] = ahead / away, left / away, math.exp(-0.5 * away)
    out[SPEED], out[SPEED + 1] = v, w
    if world.tells_path:
        length = remaining_m(field_cm, world.coarse, x, y)
        out[PATH], out[PATH + 1] = 0.1 * length, math.exp(-0.5 * length)
        _tell_direction(world, field_cm, (x, y, c, s), _NEAR_CELLS, out[PATH + 2 : PATH + 4])
        _tell_direction(world, field_cm, (x, y, c, s), _FAR_CELLS, out[PATH + 4 : PATH + 6])
    arcs = PEOPLE + world.told_people * PERSON_COUNT
    _tell_people(world, numbers, tracks, n, step, state, out[PEOPLE:arcs])
    for k in range(world.arcs.shape[0]):
        command = (world.arcs[k, 0], world.arcs[k, 1])
        elapsed_s = (step % numbers.every) * world.dt_s
        _tell_arc(world, tracks, n, elapsed_s, state, command, out[arcs + k * ARC_COUNT : arcs + (k + 1) * ARC_COUNT])


@kernel_with_cache
def _tell_direction(
    world: StateWorld,
    field_cm: UInt16Array,
    place: tuple[float, float, float, float],
    cells: int,
    out: Float32Array,
) -> None:
    """Direction in the robot's frame to where the shortest path is some cells ahead."""
    x, y, c, s = place
    to_x, to_y = point_ahead(field_cm, world.coarse, x, y, cells)
    dx, dy = to_x - x, to_y - y
    size = max(math.sqrt(dx * dx + dy * dy), 1e-6)
    out[0], out[1] = (c * dx + s * dy) / size, (c * dy - s * dx) / size


@kernel_with_cache
def _tell_people(
    world: StateWorld,
    numbers: TrackerNumbers,
    tracks: Tracks,
    n: int,
    step: int,
    state: tuple[float, float, float, float, float],
    out: Float32Array,
) -> None:
    """The nearest tracked people, the nearest first."""
    slots = tracks.mean.shape[1]
    elapsed_s = (step % numbers.every) * world.dt_s
    away = np.full(slots, np.inf)
    for m in range(slots):
        if tracks.seen_step[n, m] >= 0:
            mean = tracks.mean[n, m]
            dx = mean[0] + elapsed_s * mean[2] - state[0]
            dy = mean[1] + elapsed_s * mean[3] - state[1]
            away[m] = math.sqrt(dx * dx + dy * dy)
    for k in range(min(world.told_people, slots)):
        m = int(np.argmin(away))
        if away[m] == np.inf:
            break
        _tell_person(world, tracks, n, m, elapsed_s, step, state, out[k * PERSON_COUNT : (k + 1) * PERSON_COUNT])
        away[m] = np.inf


@kernel_with_cache
def _tell_person(
    world: StateWorld,
    tracks: Tracks,
    n: int,
    m: int,
    elapsed_s: float,
    step: int,
    state: tuple[float, float, float, float, float],
    out: Float32Array,
) -> None:
    """Presence, place, velocity, age, uncertainty, whether it should be in view, free space ahead, closest approach."""
    x, y, yaw, v, _ = state
    c, s = math.cos(yaw), math.sin(yaw)
    mean, cov = tracks.mean[n, m], tracks.cov[n, m]
    at_x, at_y = mean[0] + elapsed_s * mean[2], mean[1] + elapsed_s * mean[3]
    dx, dy = c * (at_x - x) + s * (at_y - y), c * (at_y - y) - s * (at_x - x)
    vx, vy = c * mean[2] + s * mean[3], c * mean[3] - s * mean[2]
    away = max(math.sqrt(dx * dx + dy * dy), 1e-6)
    out[0], out[1], out[2], out[3], out[4] = 1.0, dx / 4.0, dy / 4.0, vx, vy
    out[5], out[6], out[7] = math.exp(-away / 1.5), dx / away, dy / away
    out[8] = (step - tracks.seen_step[n, m]) * world.dt_s / 4.0
    out[9] = min(math.sqrt(0.5 * (cov[0, 0] + cov[1, 1])), 2.0)
    out[10] = min(math.sqrt(0.5 * (cov[2, 2] + cov[3, 3])), 2.0)
    out[11] = 1.0 if is_visible(world, x, y, yaw, at_x, at_y) else 0.0
    walking = math.atan2(mean[3], mean[2])
    for k in range(3):
        free = free_distance_m(world, at_x, at_y, walking + (k - 1) * _WALK_RAD, _WALK_M)
        out[12 + k] = math.exp(-0.5 * free)
    # Closest approach if both keep their velocities.
    rx, ry = vx - v, vy
    speed_squared = rx * rx + ry * ry
    wait = min(max(-(dx * rx + dy * ry) / max(speed_squared, 1e-6), 0.0), _CLOSEST_S)
    near_x, near_y = dx + wait * rx, dy + wait * ry
    out[15] = math.exp(-wait / 1.5)
    out[16] = math.exp(-math.sqrt(near_x * near_x + near_y * near_y))
    out[17] = near_y / 4.0


@kernel_with_cache
def _tell_arc(
    world: StateWorld,
    tracks: Tracks,
    n: int,
    elapsed_s: float,
    state: tuple[float, float, float, float, float],
    command: tuple[float, float],
    out: Float32Array,
) -> None:
    """What happens in 3 s if the robot holds a command and people keep their velocities."""
    x, y, yaw, v, w = state
    origin_x, origin_y, cell = world.place
    least, least_s, free_s = np.inf, 0.0, 0.0
    for k in range(1, _ARC_STEPS + 1):
        v, w = _limit_command(command[0], command[1], v, w, world.robot, _ARC_STEP_S)
        x, y, yaw = _step_unicycle(x, y, yaw, v, w, _ARC_STEP_S)
        i, j = math.floor((y - origin_y) / cell), math.floor((x - origin_x) / cell)
        inside = 0 <= i < world.clearance_m.shape[0] and 0 <= j < world.clearance_m.shape[1]
        if not inside or world.clearance_m[i, j] <= world.robot.radius_m:
            break
        free_s = k * _ARC_STEP_S
        for m in range(tracks.mean.shape[1]):
            if tracks.seen_step[n, m] >= 0:
                mean, later_s = tracks.mean[n, m], elapsed_s + free_s
                dx, dy = mean[0] + later_s * mean[2] - x, mean[1] + later_s * mean[3] - y
                away = math.sqrt(dx * dx + dy * dy) - world.contact_m
                if away < least:
                    least, least_s = away, free_s
    out[0] = 1.0 - free_s / (_ARC_STEP_S * _ARC_STEPS)
    out[1], out[2] = math.exp(-max(least, -0.5) / 0.5), least_s / (_ARC_STEP_S * _ARC_STEPS)


@kernel_with_cache
def know(
    world: StateWorld,
    step: int,
    state: tuple[float, float, float, float, float],
    remaining: float,
    walks_m: Float32Array,
    count: int,
    told: Float32Array,
    out: Float32Array,
) -> None:
    """Write what the critic is told: the same as the robot, the time, and where people are and will be.

    Args:
        world: Map and rules.
        step: Steps since the episode began.
        state: Robot's x, y [m], yaw [rad], v [m/s], w [rad/s].
        remaining: Remaining distance [m].
        walks_m: Where people are at every step [m], shape (T, M, 2).
        count: People in the episode.
        told: What the robot is told.
        out: To fill, shape (truth_count,).
    """
    x, y, yaw = state[0], state[1], state[2]
    c, s = math.cos(yaw), math.sin(yaw)
    at = told.shape[0]
    out[:at] = told
    out[at], out[at + 1], out[at + 2] = 0.1 * remaining, math.exp(-0.5 * remaining), step / world.step_limit
    at += _TRUTH
    last = walks_m.shape[0] - 1
    out[at:] = 0.0
    for m in range(count):
        for k in range(len(_AHEAD_S)):
            row = min(step + round(_AHEAD_S[k] / world.dt_s), last)
            hx, hy = walks_m[row, m, 0] - x, walks_m[row, m, 1] - y
            out[at], out[at + 1] = (c * hx + s * hy) / 4.0, (c * hy - s * hx) / 4.0
            out[at + 2] = math.exp(-math.sqrt(hx * hx + hy * hy))
            at += 3
