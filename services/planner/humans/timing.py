"""People on paths over time: who stops, waits and meets the robot when."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.polyline import at_lengths, length_m, resample
from readygo.services.planner.humans.robot_task import Point

ACCELERATION_MPS2 = 1.2
"""How humans speed up, and slow down for a stop (ours; mocap of everyday walking has 1 to 1.5)."""
WAIT_MAX_S = 4.0
"""Longest time that a human stands at the start in order to meet the robot later on [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """One human of an encounter."""

    speed_mps: float
    """Speed while they walk freely."""
    xy_m: Float64Array
    """Position every 0.05 s; they stand at the last one [m], shape (T, 2)."""


def time_path(
    path_m: Float64Array, speed_mps: float, *, wait_s: float = 0.0, pauses: Sequence[tuple[float, float]] = ()
) -> Float64Array:
    """Positions of a human who walks a path, with stops, and slows down at its end.

    Args:
        path_m: Polyline [m], shape (N, 2).
        speed_mps: Speed between the stops.
        wait_s: Time at the start [s]; without one they come walking.
        pauses: Where along the path [m] they stop, in order, and for how long [s].

    Returns:
        Positions every 0.05 s [m], shape (T, 2).
    """
    total_m = length_m(path_m)
    stops = np.array([*pauses, (total_m, 0.0)])
    return at_lengths(path_m, _along(stops, speed_mps, round(wait_s / DT_S)))


@kernel_with_cache
def _along(stops: Float64Array, speed: float, wait: int) -> Float64Array:
    """Distance walked at every step [m]; `stops` are distances [m] and pauses [s], shape (S, 2)."""
    a = ACCELERATION_MPS2
    # Twice the way at full speed and a speeding up and slowing down per stop are more than enough.
    steps = 2 * stops[-1, 0] / (speed * DT_S) + np.sum(stops[:, 1]) / DT_S + len(stops) * (4 * speed / (a * DT_S) + 8)
    rows = np.zeros(wait + int(steps) + 8)
    count, along = 1 + wait, 0.0
    v = 0.0 if wait > 0 else speed
    for s in range(len(stops)):
        stop = stops[s, 0]
        while stop - along > 1e-9:
            # The speed that still stops in time, in steps: v dt + v^2 / 2a is the way that is left.
            left = stop - along
            v = min(speed, v + a * DT_S, math.sqrt(a * a * DT_S * DT_S + 2 * a * left) - a * DT_S)
            along = stop if left < 0.004 else along + v * DT_S
            rows[count] = along
            count += 1
        v = 0.0
        pause = round(stops[s, 1] / DT_S)
        rows[count : count + pause] = along
        count += pause
    return rows[:count].copy()


def cut_to_meet(path_m: Float64Array, meeting_m: Point, before_m: float, *, slack_m: float) -> Float64Array | None:
    """The path without its first part, so that `before_m` remain to the meeting point; None if too little is there."""
    even, nearest, spacing_m = nearest_along(path_m, meeting_m)
    surplus = int((nearest * spacing_m - before_m) / spacing_m)
    if surplus * spacing_m < -slack_m:
        return None
    return even[max(surplus, 0) :]


def timed_to_meet(path_m: Float64Array, meeting_m: Point, meeting_s: float, speed_mps: float) -> Float64Array | None:
    """Positions of a human who is at the meeting point at that time: it starts farther along or waits; else None.

    Args:
        path_m: Where they walk, past the meeting point [m], shape (N, 2).
        meeting_m: A point near the path.
        meeting_s: When to be there [s].
        speed_mps: Speed between the stops.
    """
    even, nearest, spacing_m = nearest_along(path_m, meeting_m)
    before_m = nearest * spacing_m
    surplus = int((before_m - speed_mps * meeting_s) / spacing_m)
    if surplus >= 0:
        return time_path(even[surplus:], speed_mps) if surplus < len(even) - 2 else None
    wait_s = meeting_s - before_m / speed_mps - 0.5 * speed_mps / ACCELERATION_MPS2
    if wait_s > WAIT_MAX_S:
        return None
    return time_path(even, speed_mps, wait_s=max(wait_s, DT_S))


def nearest_along(path_m: Float64Array, point_m: Point) -> tuple[Float64Array, int, float]:
    """The path in even steps of 5 cm or so, the index nearest to a point, and the step's length [m]."""
    total_m = length_m(path_m)
    even = resample(path_m, int(total_m / 0.05) + 2)
    gaps = (even[:, 0] - point_m[0]) ** 2 + (even[:, 1] - point_m[1]) ** 2
    return even, int(np.argmin(gaps)), length_m(even) / (len(even) - 1)


def nearest_m(a: Float64Array, b: Float64Array) -> float:
    """Smallest distance of two humans at the same time [m]; the one who arrives stands still."""
    k = np.arange(max(len(a), len(b)))
    gap = a[np.minimum(k, len(a) - 1)] - b[np.minimum(k, len(b) - 1)]
    return float(np.sqrt(np.min(gap[:, 0] ** 2 + gap[:, 1] ** 2)))


def first_rows(xy_m: Float64Array, count: int) -> Float64Array:
    """The first `count` positions of a human who stands at the last one [m], shape (count, 2)."""
    return xy_m[np.minimum(np.arange(count), len(xy_m) - 1)]
