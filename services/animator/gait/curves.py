"""How feet and body move over a stride: curves of mocap at a few speeds, mixed for the speeds in between.

`curves.json` holds them; `benchmarks/motion/gait_curves.py` derives them from CMU mocap (mocap.cs.cmu.edu, NSF
EIA-0196217).
"""

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.services.animator.gait.math import clip, ease

SAMPLES = 25
"""Samples of a curve over a stance or a swing, both ends included."""
HARMONICS = 4
# Channels of the body, angles in radians, lengths in leg lengths.
PELVIS_YAW, PELVIS_LIST, PELVIS_TILT, CHEST_YAW, CHEST_LIST, CHEST_LEAN = 0, 1, 2, 3, 4, 5
ARM_FLEXION, ARM_ABDUCTION, ELBOW = 6, 7, 8
"""Channels of the left arm; the right arm moves half a stride later."""
HIP_HEIGHT, HIP_SURGE, HIP_SWAY = 9, 10, 11
"""Middle of the hips above the ankle of a flat foot, ahead of a constant speed, and to the left."""
BODY = 12
EVEN = (PELVIS_TILT, CHEST_LEAN, HIP_HEIGHT, HIP_SURGE)
"""Channels that repeat at every step; the other ones of pelvis, chest and hips change sides."""


class Curves(NamedTuple):
    """Curves of C clips, walks by increasing speed first, then runs."""

    walks: int
    """How many of the clips are walks, at least one."""
    speed: Float64Array
    """Speed [m/s] of a person with legs of 0.80 m, shape (C,)."""
    duty: Float64Array
    """Share of the stride that a foot is on the floor, shape (C,)."""
    lead: Float64Array
    """How far a foot stands ahead of the hips when it strikes [leg lengths], shape (C,)."""
    trail: Float64Array
    """How far a foot stands behind the hips when it leaves the floor [leg lengths], shape (C,)."""
    mid: Float64Array
    """Stride fraction from a foot's strike until the hips are above it, shape (C,)."""
    stance_pitch: Float64Array
    """Pitch of the foot [rad], toes down positive, over the stance, shape (C, SAMPLES)."""
    swing_pitch: Float64Array
    """Pitch of the foot [rad] over the swing, shape (C, SAMPLES)."""
    swing_way: Float64Array
    """Share of the way that the ankle has made over the swing, shape (C, SAMPLES)."""
    swing_up: Float64Array
    """Ankle above that of a flat foot [leg lengths] over the swing, shape (C, SAMPLES)."""
    body: Float64Array
    """Fourier coefficients over the stride, from the left foot's strike: mean, cosines, sines,
    shape (C, BODY, 1 + 2 * HARMONICS)."""


def curves_of(clips: Sequence[Mapping[str, Any]]) -> Curves:
    """Curves of clips as `curves.json` holds them, in any order."""
    ordered = sorted(clips, key=lambda clip: (clip["run"], clip["speed"]))
    columns = {
        name: np.array([clip[name] for clip in ordered], dtype=np.float64) for name in Curves._fields if name != "walks"
    }
    return Curves(walks=sum(not clip["run"] for clip in ordered), **columns)


@cache
def default_curves() -> Curves:
    """The curves that come with the package."""
    path = Path(__file__).with_name("curves.json")
    return curves_of(list(json.loads(path.read_text())["clips"].values()))


@kernel_with_cache
def weights_of(curves: Curves, speed: float, run: float) -> Float64Array:
    """Share of each clip at a speed (of legs of 0.80 m) and a share of running."""
    count, walks = len(curves.speed), curves.walks
    weights = np.zeros(count)
    for group in range(2):
        first, last = (0, walks - 1) if group == 0 else (walks, count - 1)
        share = 1.0 - run if group == 0 else run
        if last < first:
            continue
        k = first
        while k < last - 1 and speed > curves.speed[k + 1]:
            k += 1
        if last == first:
            weights[first] += share
        else:
            u = clip((speed - curves.speed[k]) / (curves.speed[k + 1] - curves.speed[k]), 0.0, 1.0)
            weights[k] += share * (1.0 - u)
            weights[k + 1] += share * u
    if count == walks:
        weights[walks - 1] += run
    return weights


@kernel_with_cache
def mix_clips(values: Float64Array, weights: Float64Array) -> float:
    """A number of the clips, mixed."""
    total = 0.0
    for k in range(len(weights)):
        total += weights[k] * values[k]
    return total


@kernel_with_cache
def curve_at(table: Float64Array, weights: Float64Array, x: float) -> float:
    """A curve of the clips, mixed, at share `x` of its span: cubic through the samples."""
    last = table.shape[1] - 1
    at = clip(x, 0.0, 1.0) * last
    i = min(int(at), last - 1)
    u = at - i
    total = 0.0
    for k in range(len(weights)):
        if weights[k] == 0.0:
            continue
        y = table[k]
        before = y[i - 1] if i > 0 else 2.0 * y[i] - y[i + 1]
        after = y[i + 2] if i + 2 <= last else 2.0 * y[i + 1] - y[i]
        d0, d1 = 0.5 * (y[i + 1] - before), 0.5 * (after - y[i])
        v = 1.0 - u
        value = y[i] * v * v * (1.0 + 2.0 * u) + y[i + 1] * u * u * (3.0 - 2.0 * u) + u * v * (d0 * v - d1 * u)
        total += weights[k] * value
    return total


@kernel_with_cache
def swing_of_body(body: Float64Array, weights: Float64Array, channel: int, cycle: float) -> float:
    """A channel of the body at a gait phase [strides], without its mean."""
    total = 0.0
    for k in range(len(weights)):
        if weights[k] == 0.0:
            continue
        for n in range(1, HARMONICS + 1):
            angle = 2.0 * math.pi * n * cycle
            total += weights[k] * (
                body[k, channel, n] * math.cos(angle) + body[k, channel, HARMONICS + n] * math.sin(angle)
            )
    return total


@kernel_with_cache
def stride_rate(speed_mps: float, size: float, run: float) -> float:
    """Strides per second of a walk (`run` 0), a run (1), or a change between them.

    The fits of cadence (66.4 + 38.9 v per minute) and of step length (0.158 + 0.417 v metres) to mocap at legs of
    0.80 m do not multiply to v exactly; the rate is the geometric mean of what each of them asks for. Above 1.5 m/s,
    beyond the fits' data, steps stop growing with speed and the cadence takes over. Runners lengthen their steps and
    hardly change the cadence: 157 per minute at 2.6 to 2.9 m/s.
    """
    v = speed_mps / math.sqrt(size)
    cadence = 66.4 + 38.9 * v
    from_step = 60.0 * v / (0.158 + 0.417 * v)
    share = 0.5 + 0.5 * ease((v - 1.45) / 0.55)
    walking = math.exp(share * math.log(cadence) + (1.0 - share) * math.log(max(from_step, 1e-9)))
    running = 157.0 + 7.0 * (v - 2.75)
    return (walking + run * (running - walking)) / 120.0 / math.sqrt(size)


@kernel_with_cache
def gain_of(curves: Curves, weights: Float64Array, speed: float, run: float) -> float:
    """Length of a step at a speed relative to that of the mixed clips: 1 between clips, less below the slowest one."""
    known = mix_clips(curves.speed, weights)
    if speed < 1e-3:
        return 0.0
    return clip((speed / stride_rate(speed, 1.0, run)) / (known / stride_rate(known, 1.0, run)), 0.0, 1.2)
