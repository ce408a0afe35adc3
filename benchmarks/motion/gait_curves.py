"""The gait's curves from CMU mocap: `python -m readygo.benchmarks.motion.gait_curves FOLDER [--out FILE]`.

FOLDER holds 02.asf and 02_01.amc, 02_02.amc (walks), 02_03.amc (a run). What it writes is
`services/animator/gait/curves.json`, see `services/animator/gait/curves.py` for its meaning.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.benchmarks.motion.cmu import RATE_HZ, read_clip
from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.services.animator.gait.curves import BODY, CHEST_YAW, EVEN, HARMONICS, SAMPLES
from readygo.services.animator.gait.human import REFERENCE_LEG_M

WALKS, RUNS = ("02_01", "02_02"), ("02_03",)
# A foot strikes when its ankle slows down to this share of the speed, and leaves when its ball is this fast.
STRIKE_SHARE, RUN_STRIKE_SHARE, LEAVE_MPS = 1.1, 0.6, 0.7
FLAT = (0.3, 0.45)
"""Share of the stance in which the sole lies flat."""
FLAT_SLACK_RAD = np.radians(2.0)
"""Pitches nearer to flat than this are flat."""


@dataclass(frozen=True, kw_only=True)
class Clip:
    """A straight walk or run, heading along +z, its floor level."""

    joints_m: Float64Array
    """SMPL joints at 120 Hz, shape (T, 22, 3)."""
    R_bones: dict[str, Float64Array]
    leg_m: float
    speed_mps: float
    hip_line_m: Float64Array
    """Where the hips would be at constant speed, shape (T,)."""
    stances: tuple[Float64Array, Float64Array]
    """Frames of strike and lift-off of the left and the right foot, each (N, 2), strikes increasing."""


def _crossings(above: BoolArray, rising: bool) -> Float64Array:
    change = np.diff(above.astype(int))
    frames: Float64Array = np.flatnonzero(change == (1 if rising else -1)) + 1.0
    return frames


def _stances(joints_m: Float64Array, speed_mps: float, strike_share: float) -> tuple[Float64Array, Float64Array]:
    """Strike and next lift-off of each foot [frames]."""
    found = []
    for ankle, ball in ((7, 10), (8, 11)):
        pace = [np.linalg.norm(np.gradient(joints_m[:, j], axis=0), axis=1) * RATE_HZ for j in (ankle, ball)]
        strikes = _crossings(pace[0] > strike_share * speed_mps, rising=False)
        leaves = _crossings(pace[1] > LEAVE_MPS, rising=True)
        pairs = []
        for strike in strikes:
            after = leaves[leaves > strike + 0.1 * RATE_HZ]
            if len(after):
                pairs.append((strike, after[0]))
        found.append(np.array(pairs))
    return found[0], found[1]


def load_clip(folder: Path, name: str) -> Clip:
    """Read a clip, turn it to +z and level its floor."""
    P, G = read_clip(folder, name)
    way = P[-1, 0] - P[0, 0]
    yaw = np.arctan2(way[0], way[2])
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    P, G = P @ turn.T, {bone: turn @ R for bone, R in G.items()}
    time = np.arange(len(P))
    hips = 0.5 * (P[:, 1] + P[:, 2])
    slope, start = np.polyfit(time, hips[:, 2], 1)
    speed = float(slope * RATE_HZ)
    stances = _stances(P, speed, RUN_STRIKE_SHARE if name in RUNS else STRIKE_SHARE)
    flat = [np.concatenate(_flat_frames(pairs, len(P))) for pairs in stances]
    rise, base = np.polyfit(*np.concatenate([P[f, 7 + foot][:, [2, 1]] for foot, f in enumerate(flat)]).T, 1)
    P = P - np.array([0.0, 1.0, 0.0]) * (rise * hips[:, 2] + base)[:, None, None]
    leg = float(np.mean([np.linalg.norm(P[0, a] - P[0, b]) for a, b in ((1, 4), (2, 5))])) + float(
        np.mean([np.linalg.norm(P[0, a] - P[0, b]) for a, b in ((4, 7), (5, 8))])
    )
    return Clip(joints_m=P, R_bones=G, leg_m=leg, speed_mps=speed, hip_line_m=slope * time + start, stances=stances)


def _flat_frames(pairs: Float64Array, count: int) -> list[Int64Array]:
    """Frames of each stance in which the sole lies flat."""
    share = np.array(FLAT)
    return [np.arange(*np.rint(a + (b - a) * share).astype(int)).clip(0, count - 1) for a, b in pairs]


def _pitch(clip: Clip, foot: int) -> Float64Array:
    """Pitch of a foot relative to a flat sole [rad], toes down positive, shape (T,)."""
    sole = clip.joints_m[:, 10 + foot] - clip.joints_m[:, 7 + foot]
    pitch: Float64Array = np.arctan2(-sole[:, 1], sole[:, 2])
    return pitch - np.median(pitch[np.concatenate(_flat_frames(clip.stances[foot], len(pitch)))])


def _spans(clip: Clip, swing: bool) -> list[tuple[int, Float64Array]]:
    """Foot and sample times [frames] of all whole stances or swings."""
    spans = []
    for foot, pairs in enumerate(clip.stances):
        ends = zip(pairs[:-1, 1], pairs[1:, 0], strict=True) if swing else pairs
        spans += [(foot, np.linspace(first, last, SAMPLES)) for first, last in ends]
    return spans


def _mean_curve(clip: Clip, swing: bool, series: tuple[Float64Array, Float64Array]) -> Float64Array:
    """Mean over stances or swings of a series per foot, shape (SAMPLES,)."""
    frames = np.arange(len(clip.joints_m))
    curves = [np.interp(times, frames, series[foot]) for foot, times in _spans(clip, swing)]
    mean: Float64Array = np.mean(curves, axis=0)
    return mean


def _flat_between(pitch: Float64Array) -> Float64Array:
    """A stance's pitch with the sole exactly flat between heel strike and heel-off."""
    middle = round((SAMPLES - 1) * FLAT[0])
    size = np.abs(pitch)
    rest = np.where(size < 2 * FLAT_SLACK_RAD, size**2 / (4 * FLAT_SLACK_RAD), size - FLAT_SLACK_RAD)
    # The ends keep their pitch: only what is nearly flat is made so.
    kept = rest + FLAT_SLACK_RAD * np.clip(size / FLAT_SLACK_RAD / 4.0 - 0.5, 0.0, 1.0)
    ahead, behind = np.minimum(np.sign(pitch) * kept, 0.0), np.maximum(np.sign(pitch) * kept, 0.0)
    flat: Float64Array = np.where(np.arange(SAMPLES) <= middle, ahead, behind)
    return flat


def feet_of(clip: Clip) -> dict[str, Any]:
    """Durations, reaches and curves of the feet."""
    stride = float(np.mean(np.concatenate([np.diff(pairs[:, 0]) for pairs in clip.stances]))) / RATE_HZ
    stance = float(np.mean(np.concatenate([np.diff(pairs, axis=1)[:, 0] for pairs in clip.stances]))) / RATE_HZ
    leads = []
    for foot, pairs in enumerate(clip.stances):
        for flat, (strike, _) in zip(_flat_frames(pairs, len(clip.joints_m)), pairs, strict=True):
            leads.append(clip.joints_m[flat, 7 + foot, 2].mean() - clip.hip_line_m[int(strike)])
    lead = float(np.mean(leads))
    pitches = _pitch(clip, 0), _pitch(clip, 1)
    swing_pitch, stance_pitch = _mean_curve(clip, True, pitches), _flat_between(_mean_curve(clip, False, pitches))
    swing_pitch[0], swing_pitch[-1] = stance_pitch[-1], stance_pitch[0]
    ahead = _mean_curve(
        clip, True, (clip.joints_m[:, 7, 2] - clip.hip_line_m, clip.joints_m[:, 8, 2] - clip.hip_line_m)
    )
    way = ahead - ahead[0] + clip.speed_mps * (stride - stance) * np.linspace(0.0, 1.0, SAMPLES)
    return {
        "duty": stance / stride,
        "lead": lead / clip.leg_m,
        "trail": (clip.speed_mps * stance - lead) / clip.leg_m,
        "mid": lead / (clip.speed_mps * stride),
        "stance_pitch": stance_pitch,
        "swing_pitch": swing_pitch,
        "swing_way": way / way[-1],
        "swing_up": _mean_curve(clip, True, (clip.joints_m[:, 7, 1], clip.joints_m[:, 8, 1])) / clip.leg_m,
    }


def _cycle(clip: Clip) -> Float64Array:
    """Gait phase of every frame [strides]: whole at the left foot's strikes."""
    left, right = (pairs[:, 0] for pairs in clip.stances)
    first = np.round((right[0] - left[0]) / np.mean(np.diff(left) if len(left) > 1 else np.diff(right)) - 0.5)
    strikes = np.concatenate([left, right])
    phases = np.concatenate([np.arange(len(left)), np.arange(len(right)) + first + 0.5])
    order = np.argsort(strikes)
    rate = np.polyfit(strikes, phases, 1)[0]
    strikes, phases = strikes[order], phases[order]
    frames = np.arange(len(clip.joints_m))
    beyond = np.clip(frames - strikes[-1], 0, None) + np.clip(frames - strikes[0], None, 0)
    cycle: Float64Array = np.interp(frames, strikes, phases) + rate * beyond
    return cycle


def _arm(clip: Clip, side: int) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Flexion and abduction of an upper arm, relative to hanging, and the bend of the elbow [rad], each (T,)."""
    P, outward = clip.joints_m, 1.0 - 2.0 * side
    upper, lower = P[:, 18 + side] - P[:, 16 + side], P[:, 20 + side] - P[:, 18 + side]
    cosine = np.sum(upper * lower, axis=1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
    flexion = np.arctan2(upper[:, 2], -upper[:, 1])
    abduction = np.arcsin(outward * upper[:, 0] / np.linalg.norm(upper, axis=1))
    return flexion, abduction, np.arccos(cosine)


def _fit(series: list[Float64Array], cycles: list[Float64Array], harmonics: list[int], mean: bool) -> Float64Array:
    """Fourier coefficients (mean, cosines, sines) of series that also may drift, shape (1 + 2 * HARMONICS,)."""
    rows = []
    for k, cycle in enumerate(cycles):
        waves = [f(2.0 * np.pi * n * cycle) for f in (np.cos, np.sin) for n in harmonics]
        drift = [np.where(k == i, 1.0, 0.0) * (cycle - cycle.mean()) for i in range(len(cycles))]
        offset = [np.full_like(cycle, k == i) for i in range(len(cycles))] if not mean else [np.ones_like(cycle)]
        rows.append(np.stack([*waves, *offset, *drift], axis=1))
    solution = np.linalg.lstsq(np.concatenate(rows), np.concatenate(series), rcond=None)[0]
    coefficients = np.zeros(1 + 2 * HARMONICS)
    for i, n in enumerate(harmonics):
        coefficients[n], coefficients[HARMONICS + n] = solution[i], solution[len(harmonics) + i]
    coefficients[0] = solution[2 * len(harmonics)] if mean else 0.0
    return coefficients


def body_of(clip: Clip) -> Float64Array:
    """Fourier coefficients of the body's channels, shape (BODY, 1 + 2 * HARMONICS)."""
    cycle, hips = _cycle(clip), 0.5 * (clip.joints_m[:, 1] + clip.joints_m[:, 2])
    channels: list[list[Float64Array]] = []
    for bone in ("root", "thorax"):
        R = clip.R_bones[bone]
        yaw, tilt = np.arctan2(R[:, 0, 2], R[:, 2, 2]), np.arctan2(R[:, 2, 1], R[:, 1, 1])
        channels += [[yaw], [np.arcsin(R[:, 1, 0])], [tilt]]
    across = clip.joints_m[:, 16] - clip.joints_m[:, 17]
    channels[CHEST_YAW] = [np.arctan2(-across[:, 2], across[:, 0])]
    channels += [list(pair) for pair in zip(_arm(clip, 0), _arm(clip, 1), strict=True)]
    channels += [[hips[:, 1] / clip.leg_m], [(hips[:, 2] - clip.hip_line_m) / clip.leg_m], [hips[:, 0] / clip.leg_m]]
    body = np.zeros((BODY, 1 + 2 * HARMONICS))
    for channel, series in enumerate(channels):
        if len(series) == 2:
            body[channel] = _fit(series, [cycle, cycle - 0.5], list(range(1, HARMONICS + 1)), True)
        else:
            harmonics = [n for n in range(1, HARMONICS + 1) if (n % 2 == 0) == (channel in EVEN)]
            body[channel] = _fit(series, [cycle], harmonics, channel in EVEN)
    return body


def derive(folder: Path, name: str) -> dict[str, Any]:
    """All curves of a clip, as `curves.json` holds them."""
    clip = load_clip(folder, name)
    numbers = {**feet_of(clip), "body": body_of(clip)}
    rounded = {key: np.round(np.asarray(value), 4).tolist() for key, value in numbers.items()}
    speed = clip.speed_mps / np.sqrt(clip.leg_m / REFERENCE_LEG_M)
    return {"run": name in RUNS, "speed": round(float(speed), 4), **rounded}


def main() -> None:
    """Derive the curves and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the .asf and .amc files")
    parser.add_argument("--out", type=Path, default=Path("services/animator/gait/curves.json"))
    options = parser.parse_args()
    clips = {name: derive(options.folder, name) for name in WALKS + RUNS}
    source = "CMU Graphics Lab Motion Capture Database, mocap.cs.cmu.edu, funded by NSF EIA-0196217"
    lines = [
        f' "{name}": {{\n' + ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in clip.items()) + "}"
        for name, clip in clips.items()
    ]
    options.out.write_text(f'{{"source": {json.dumps(source)},\n"clips": {{\n' + ",\n".join(lines) + "}}\n")


if __name__ == "__main__":
    main()
