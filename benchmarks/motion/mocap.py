"""The gait beside CMU mocap: leg curves, jerk, and curves fitted to one walk and judged on the other."""

import itertools
from pathlib import Path

import numpy as np

from readygo.benchmarks.motion.cmu import RATE_HZ
from readygo.benchmarks.motion.gait_curves import RUNS, WALKS, derive, load_clip
from readygo.benchmarks.motion.paths import floor, line
from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.services.animator import skeleton_of, walk
from readygo.services.animator.gait.curves import Curves, curves_of
from readygo.services.animator.gait.quality import joints_of

PHASES = 50
STEADY = slice(60, 240)
"""Rows of a motion of 13 s in which the walk is steady."""


def _peaks(values: Float64Array, apart: int) -> list[float]:
    """Fractional places of the largest values within `apart` samples to both sides."""
    found = []
    for i in range(apart, len(values) - apart):
        before, here, after = values[i - 1 : i + 2]
        if here == values[i - apart : i + apart + 1].max():
            found.append(i + 0.5 * (before - after) / (before - 2.0 * here + after))
    return found


def leg_curves_deg(P: Float64Array, rate_hz: float, forward: Float64Array, up: Float64Array) -> Float64Array:
    """Mean hip and knee angles over a stride.

    Args:
        P: SMPL joints of a straight walk [m], shape (T, >= 11, 3).
        rate_hz: Their rate.
        forward: Direction of the walk, a unit vector.
        up: The vertical.

    Returns:
        Thigh from the vertical (forward positive) and bend of the knee [deg] at 50 phases, from an ankle's forward
        peak on, mean over strides and sides, shape (2, 50).
    """
    strides = []
    for side in range(2):
        thigh, shin = P[:, 4 + side] - P[:, 1 + side], P[:, 7 + side] - P[:, 4 + side]
        hip, lower = (np.degrees(np.arctan2(bone @ forward, -(bone @ up))) for bone in (thigh, shin))
        reach = (P[:, 7 + side] - 0.5 * (P[:, 1] + P[:, 2])) @ forward
        for first, last in itertools.pairwise(_peaks(reach, round(0.12 * rate_hz))):
            times = first + (last - first) * np.arange(PHASES) / PHASES
            strides.append([np.interp(times, np.arange(len(P)), angle) for angle in (hip, hip - lower)])
    mean: Float64Array = np.mean(strides, axis=0)
    return mean


def jerks_mps3(P: Float64Array, rate_hz: float) -> Float64Array:
    """Third differences of joints 0..21, shape (T - 3, 22)."""
    sizes: Float64Array = np.linalg.norm(np.diff(P[:, :22], n=3, axis=0), axis=-1) * rate_hz**3
    return sizes


def steady_joints(avatar: Avatar, speed: float, curves: Curves | None = None) -> Float64Array:
    """Joints at 20 Hz of a steady straight walk along +x [m].

    Args:
        avatar: Who.
        speed: What legs of 0.80 m would walk [m/s]; other legs go as much faster as the root of their length.
        curves: How; those of the package if None.
    """
    skeleton = skeleton_of(avatar)
    xy = line(speed * np.sqrt(skeleton.size), 13.0)
    motion = walk(skeleton, xy, floor(half_m=30.0), np.random.default_rng(0), 0.0, curves)
    return joints_of(motion, avatar)[1][STEADY]


def compare(avatar: Avatar, folder: Path, judge: str, fitted: tuple[str, ...]) -> dict[str, float]:
    """A walk with curves of some clips beside another clip, at that clip's speed and at 20 Hz.

    Args:
        avatar: Who walks.
        folder: The .asf and .amc files.
        judge: The clip to be like.
        fitted: The clips whose curves are used.

    Returns:
        Root mean square errors of hip and knee curve [deg]; mean and 99th percentile of the jerk over the mocap's.
    """
    mocap = load_clip(folder, judge).joints_m
    speed = derive(folder, judge)["speed"]
    ours = steady_joints(avatar, speed, curves_of([derive(folder, name) for name in fitted]))
    x, y, z = np.eye(3)
    errors = leg_curves_deg(ours, 20.0, x, z) - leg_curves_deg(mocap, RATE_HZ, z, y)
    hip, knee = np.sqrt(np.mean(errors**2, axis=1))
    a, b = jerks_mps3(ours, 20.0), jerks_mps3(mocap[:: RATE_HZ // 20], 20.0)
    return {
        "hip_rmse_deg": float(hip),
        "knee_rmse_deg": float(knee),
        "jerk_mean_ratio": float(a.mean() / b.mean()),
        "jerk_p99_ratio": float(np.percentile(a, 99) / np.percentile(b, 99)),
    }


def compare_all(avatar: Avatar, folder: Path) -> dict[str, dict[str, float]]:
    """Each walk with the curves of the other one, and the run with those of the package."""
    pairs = [(WALKS[1], WALKS[:1]), (WALKS[0], WALKS[1:]), (RUNS[0], WALKS + RUNS)]
    return {f"{judge} by {'+'.join(fitted)}": compare(avatar, folder, judge, fitted) for judge, fitted in pairs}
