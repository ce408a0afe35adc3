"""From a ground trajectory to a heading, walking bouts and a gait phase.

Phases count strides: the foot that leads a bout strikes at 0, 1, 2, ..., the other one half a stride later.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.errors import MotionError
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S
from readygo.services.animator.gait.curves import Curves, stride_rate
from readygo.services.animator.gait.human import GaitStyle
from readygo.services.animator.gait.math import clip, ease, smooth, wrap

SPEED_MAX_MPS = 5.0
MOVING_START_MPS = 0.3
LEAD_IN_FRAMES = 40
RATE_FALL_PER_S2 = 0.6
RUN_ABOVE_MPS, WALK_BELOW_MPS = 2.2, 2.0
"""Speeds at which people with legs of 0.80 m begin to run, and fall back into a walk [m/s]."""


class GaitTrack(NamedTuple):
    """A trajectory in the y-up world at 20 Hz, with lead-in and settling frames."""

    x: Float64Array
    z: Float64Array
    psi: Float64Array
    """Heading [rad]: 0 faces +z, positive turns left (towards +x); not wrapped, shape (T,)."""
    speed: Float64Array
    """Smoothed speed [m/s], shape (T,)."""
    pace: Float64Array
    """Speed [m/s] smoothed within each bout only, which sets steps and cadence up to an abrupt stop, shape (T,)."""
    run: Float64Array
    """0 walking (or standing), 1 running, shape (T,)."""
    rate: Float64Array
    """Strides per second where the person is walking or turning, shape (T,)."""
    phase: Float64Array
    """Gait phase of each frame's bout, in strides of the leading foot, shape (T,)."""
    bouts: Int64Array
    """First frame, last frame and leading side (0 left, 1 right) of each bout, shape (B, 3)."""


def check_trajectory(xy_m: Float64Array) -> None:
    """Refuse trajectories that no person can follow.

    Raises:
        MotionError: If there is no point, a value is not finite, or a step is faster than 5 m/s.
    """
    if xy_m.ndim != 2 or xy_m.shape[1] != 2 or len(xy_m) == 0:
        raise MotionError(f"A trajectory must have shape (T, 2) with at least one row, got {xy_m.shape}.")
    bad = ~np.isfinite(xy_m).all(axis=1)
    if bad.any():
        raise MotionError(f"Row {int(np.argmax(bad))} of the trajectory is not finite; plan it again.")
    step = np.diff(xy_m, axis=0)
    speed = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2) / DT_S
    if len(speed) and speed.max() > SPEED_MAX_MPS:
        row = int(np.argmax(speed))
        raise MotionError(
            f"The trajectory jumps at {speed[row]:.1f} m/s from row {row} to {row + 1}; "
            f"people move at most {SPEED_MAX_MPS:.0f} m/s between rows at 20 Hz."
        )


def extend(
    xy_m: Float64Array, style: GaitStyle, stride_s: float, settle_s: float
) -> tuple[Float64Array, Float64Array, int]:
    """The trajectory in y-up axes with frames before and after it.

    A trajectory that starts in motion gets a straight walk before it, so that its first row lies in mid-gait at a
    phase that differs from person to person.

    Returns:
        x and z [m], shape (T,), and the number of frames before the trajectory's first row.
    """
    x, z = xy_m[:, 0].astype(np.float64), -xy_m[:, 1].astype(np.float64)
    lead = 0
    if len(x) >= 3:
        vx, vz = 0.5 * (x[2] - x[0]), 0.5 * (z[2] - z[0])
        if math.sqrt(vx * vx + vz * vz) / DT_S > MOVING_START_MPS:
            lead = LEAD_IN_FRAMES + round(style.stride_offset * stride_s / DT_S)
            back = np.arange(-lead, 0, dtype=np.float64)
            x, z = np.concatenate([x[0] + back * vx, x]), np.concatenate([z[0] + back * vz, z])
            # Standing before the walk, so that the first bout begins like any other.
            x, z = np.concatenate([np.full(10, x[0]), x]), np.concatenate([np.full(10, z[0]), z])
            lead += 10
    tail = math.ceil(settle_s / DT_S)
    return np.concatenate([x, np.full(tail, x[-1])]), np.concatenate([z, np.full(tail, z[-1])]), lead


@kernel_with_cache
def run_share(pace: Float64Array, size: float) -> Float64Array:
    """When the person runs: from 2.2 m/s on until the pace falls below 2.0 m/s, faded over half a second."""
    run, running = np.zeros(len(pace)), False
    for i in range(len(pace)):
        v = pace[i] / math.sqrt(size)
        running = v > WALK_BELOW_MPS if running else v > RUN_ABOVE_MPS
        run[i] = 1.0 if running else 0.0
    return smooth(run, 3.0)


@kernel_with_cache
def _headings_of_walk(x: Float64Array, z: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Direction of travel where the smoothed speed defines one, unwrapped over time."""
    sx, sz = smooth(x, 4.0), smooth(z, 4.0)
    count = len(x)
    psi, known = np.zeros(count), np.zeros(count, np.bool_)
    last = np.nan
    for i in range(count):
        a, b = max(i - 1, 0), min(i + 1, count - 1)
        vx, vz = sx[b] - sx[a], sz[b] - sz[a]
        if math.sqrt(vx * vx + vz * vz) > 0.2 * DT_S * (b - a):
            angle = math.atan2(vx, vz)
            last = angle if math.isnan(last) else last + wrap(angle - last)
            psi[i], known[i] = last, True
    return psi, known


@kernel_with_cache
def heading(x: Float64Array, z: Float64Array, default_rad: float) -> Float64Array:
    """Where the person faces: along the way while walking, held while standing, turned before setting off.

    Args:
        x: y-up world x [m], shape (T,).
        z: y-up world z [m], shape (T,).
        default_rad: Heading of a person who never moves.

    Returns:
        Heading [rad], not wrapped, at most 2.6 rad/s, shape (T,).
    """
    psi, known = _headings_of_walk(x, z)
    count = len(x)
    before = -1
    for i in range(count):
        if not known[i]:
            continue
        for k in range(before + 1, i):
            if before < 0:
                psi[k] = psi[i]
            else:
                turn = psi[i] - psi[before]
                frames = min(max(abs(turn) / 1.2 / DT_S, 10.0), float(i - before))
                psi[k] = psi[before] + turn * ease((k - (i - frames)) / frames)
        before = i
    for k in range(before + 1, count):
        psi[k] = psi[before] if before >= 0 else default_rad
    step = 2.6 * DT_S
    late, early = psi.copy(), psi.copy()
    for i in range(1, count):
        late[i] = late[i - 1] + clip(psi[i] - late[i - 1], -step, step)
        k = count - 1 - i
        early[k] = early[k + 1] + clip(psi[k] - early[k + 1], -step, step)
    return smooth(0.5 * (late + early), 2.5)


@kernel_with_cache
def _active(x: Float64Array, z: Float64Array, psi: Float64Array) -> BoolArray:
    """Frames in which the feet must step: walking, turning, or drifting away from where they stand."""
    count = len(x)
    active = np.zeros(count, np.bool_)
    for i in range(count):
        a, b = max(i - 1, 0), min(i + 1, count - 1)
        span = max(b - a, 1) * DT_S
        vx, vz = (x[b] - x[a]) / span, (z[b] - z[a]) / span
        active[i] = vx * vx + vz * vz > 0.08**2 or abs(psi[b] - psi[a]) / span > 0.25
    anchor = 0
    for i in range(count):
        if active[i]:
            anchor = i
        elif (x[i] - x[anchor]) ** 2 + (z[i] - z[anchor]) ** 2 > 0.05**2 or abs(psi[i] - psi[anchor]) > 0.3:
            for k in range(max(i - 8, 0), min(i + 1, count)):
                active[k] = True
            anchor = i
    return active


@kernel_with_cache
def _bouts(x: Float64Array, z: Float64Array, psi: Float64Array, lead_left: float) -> Int64Array:
    """Spans of stepping; pauses too short for closing the feet and setting off again are walked through."""
    active = _active(x, z, psi)
    count = len(x)
    spans = np.empty((count, 3), np.int64)
    found = 0
    for i in range(count):
        if not active[i]:
            continue
        if found > 0 and i - spans[found - 1, 1] < 26:
            spans[found - 1, 1] = i
        else:
            spans[found, 0], spans[found, 1] = i, i
            found += 1
    kept = 0
    for b in range(found):
        first, last = spans[b, 0], spans[b, 1]
        way = 0.0
        for i in range(first, last):
            way = max(way, (x[i + 1] - x[first]) ** 2 + (z[i + 1] - z[first]) ** 2)
        if way < 0.03**2 and abs(psi[last] - psi[first]) < 0.1:
            continue
        turn = psi[min(first + 16, last)] - psi[first]
        left = turn > 0.0 if abs(turn) > 0.25 else (lead_left < 0.5) == (kept % 2 == 0)
        spans[kept, 0], spans[kept, 1], spans[kept, 2] = first, last, 0 if left else 1
        kept += 1
    return spans[:kept].copy()


@kernel_with_cache
def _phases(rate: Float64Array, bouts: Int64Array, mid_stance: float) -> Float64Array:
    """Gait phase of every frame; between two bouts the phase of the nearer one runs on."""
    count = len(rate)
    phase = np.zeros(count)
    for b in range(len(bouts)):
        first, last = bouts[b, 0], bouts[b, 1]
        begin = 0 if b == 0 else (bouts[b - 1, 1] + first) // 2
        end = count if b == len(bouts) - 1 else (last + bouts[b + 1, 0]) // 2
        # The other foot's stance centre coincides with the start: both feet stand below the pelvis.
        phase[first] = mid_stance - 0.5
        for i in range(first + 1, end):
            a, c = (rate[i - 1], rate[i]) if i <= last else (rate[last], rate[last])
            phase[i] = phase[i - 1] + 0.5 * (a + c) * DT_S
        for k in range(first - begin):
            i = first - 1 - k
            phase[i] = phase[i + 1] - rate[first] * DT_S
    return phase


@kernel_with_cache
def time_of_phase(track: GaitTrack, bout: int, phase: float) -> float:
    """Time [s] at which a bout reaches a phase; beyond its ends the rate there runs on."""
    first, last = track.bouts[bout, 0], track.bouts[bout, 1]
    time_s: float = first * DT_S - (track.phase[first] - phase) / track.rate[first]
    if phase <= track.phase[first]:
        return time_s
    if phase >= track.phase[last]:
        time_s = last * DT_S + (phase - track.phase[last]) / track.rate[last]
        return time_s
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if track.phase[middle] <= phase:
            low = middle
        else:
            high = middle
    time_s = (low + (phase - track.phase[low]) / (track.phase[high] - track.phase[low])) * DT_S
    return time_s


@kernel_with_cache
def _quicken(
    rate: Float64Array, raw: Float64Array, run: Float64Array, bouts: Int64Array, cadence: float, size: float
) -> None:
    """Keep the steps quick up to an abrupt stop, where smoothed speeds fall early, and while the feet close."""
    near = smooth(raw, 1.0)
    for i in range(len(rate)):
        rate[i] = max(rate[i], stride_rate(near[i], size, run[i]) * cadence)
        if i > 0:
            rate[i] = max(rate[i], rate[i - 1] - RATE_FALL_PER_S2 * DT_S)
    for b in range(len(bouts)):
        for edge in range(2):
            rate[bouts[b, edge]] = max(rate[bouts[b, edge]], 0.85 + 0.15 * edge)


@kernel_with_cache
def plan_track(x: Float64Array, z: Float64Array, style: GaitStyle, size: float, curves: Curves) -> GaitTrack:
    """Heading, speed, bouts and phases of an extended trajectory.

    Args:
        x: y-up world x [m], shape (T,).
        z: y-up world z [m], shape (T,).
        style: Habits of the person.
        size: Leg length relative to the reference.
        curves: How people walk.
    """
    count = len(x)
    psi = heading(x, z, style.heading_rad)
    raw, turn = np.empty(count), np.empty(count)
    for i in range(count):
        a, b = max(i - 1, 0), min(i + 1, count - 1)
        span = max(b - a, 1) * DT_S
        raw[i] = math.sqrt((x[b] - x[a]) ** 2 + (z[b] - z[a]) ** 2) / span
        turn[i] = abs(psi[b] - psi[a]) / span
    speed = smooth(raw, 2.5)
    bouts = _bouts(x, z, psi, style.lead_left)
    pace = speed.copy()
    for b in range(len(bouts)):
        first, last = bouts[b, 0], bouts[b, 1]
        if last - first >= 4:
            # Central differences are halved at an abrupt start or stop.
            pace[first + 2 : last - 1] = smooth(raw[first + 2 : last - 1], 2.5)
            pace[first : first + 2], pace[last - 1 : last + 1] = pace[first + 2], pace[last - 2]
    rate, run = np.empty(count), run_share(pace, size)
    for i in range(count):
        walking = stride_rate(pace[i], size, run[i]) * style.cadence
        turning = clip(0.35 + 0.4 * turn[i], 0.0, 1.2)
        rate[i] = max(walking, turning, 0.62)
    _quicken(rate, raw, run, bouts, style.cadence, size)
    return GaitTrack(x, z, psi, speed, pace, run, rate, _phases(rate, bouts, curves.mid[0]), bouts)
