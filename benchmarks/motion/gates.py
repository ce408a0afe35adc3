"""`readygo bench motion`: the gates of the gait, measured on the motions alone, and what a motion costs."""

import dataclasses
import json as json_module
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from readygo.benchmarks.motion.mocap import compare_all
from readygo.benchmarks.motion.paths import circle, dash, floor, line, s_curve, stop_and_go, turn_in_place
from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar, load_avatars
from readygo.common.errors import ConfigError
from readygo.common.frames import yup_from_zup
from readygo.common.maps.grid import FloorMap
from readygo.services.animator import measure, skeleton_of, walk
from readygo.services.animator.gait.curves import stride_rate
from readygo.services.animator.gait.quality import cadence_per_min, heights_above, joints_of, sole_points
from readygo.services.animator.priormdm.features import (
    Start,
    decode_joints,
    decode_path,
    encode,
    encode_path,
)

MOCAP = Path(__file__).resolve().parents[3] / "shared" / "data" / "motion" / "cmu"
PATHS = {
    "straight": line,
    "circle r=1.5 m": circle,
    "S-curve": s_curve,
    "stop-and-go": stop_and_go,
    "turn in place": turn_in_place,
}
SPEEDS_MPS, RUN_SPEEDS_MPS, STEADY_SPEEDS_MPS = (0.6, 0.9, 1.2, 1.6, 2.0), (2.5, 3.0, 3.5), (0.9, 1.2, 1.4, 1.6)
FLOORS = {
    "flat": floor(half_m=24.0),
    "slope 11 %": floor(lambda x, y: 0.10 * x + 0.05 * y),
    "bumps 3 cm": floor(lambda x, y: 0.03 * np.sin(2.0 * x) * np.cos(1.5 * y)),
}
FLIGHT_M = 0.01
"""With both soles higher than this above the floor a runner flies."""


class MotionGate(NamedTuple):
    """A number and what it must be."""

    name: str
    value: float
    low: float
    high: float

    @property
    def held(self) -> bool:
        """True if the number is within its limits."""
        return bool(self.low <= self.value <= self.high)


@dataclass(frozen=True, kw_only=True)
class BenchMotionOptions:
    """Measure how human the gait is, on straight, curved, interrupted and turning paths."""

    avatar: str = ""
    """An embedded avatar's name, or an avatar file; empty is the first embedded one."""
    style: float = 1.0
    """How much people differ, 0 to 1."""
    mocap: Path | None = None
    """Folder of CMU's 02.asf, 02_01.amc, 02_02.amc and 02_03.amc; by default shared/data/motion/cmu beside the
    project, if it is there."""
    json: bool = False
    """Print one JSON object instead of a table."""


def bench_motion(options: BenchMotionOptions) -> None:
    """Measure how human the gait is, on straight, curved, interrupted and turning paths."""
    body = _avatar(options.avatar)
    gates = [
        *path_gates(body, options.style),
        *steady_gates(body),
        *run_gates(body, options.style),
        *feature_gates(body),
    ]
    folder = options.mocap or MOCAP
    gates += mocap_gates(body, folder) if folder.is_dir() else []
    gates.append(MotionGate("ms_per_10s", cost_ms(body), 0.0, 60.0))
    mocap_note = "present" if folder.is_dir() else "absent"
    if options.json:
        rows = [{**gate._asdict(), "held": gate.held} for gate in gates]
        result: dict[str, Any] = {"avatar": body.name, "mocap": mocap_note, "gates": rows}
        sys.stdout.write(json_module.dumps(result) + "\n")
        return
    _print(gates, body.name, mocap_note)


def _avatar(name: str) -> Avatar:
    avatars = load_avatars(Path(name)) if name.endswith(".npz") else load_avatars()
    if not name.endswith(".npz") and name and name not in avatars:
        raise ConfigError(f"Avatar {name!r} is not embedded; there are {', '.join(sorted(avatars))}.")
    return avatars[name if name in avatars else sorted(avatars)[0]]


def _print(gates: list[MotionGate], name: str, mocap_note: str) -> None:
    width = max(len(gate.name) for gate in gates)
    for gate in gates:
        verdict = "" if gate.held else "  BEYOND"
        sys.stdout.write(f"{gate.name:<{width}}  {gate.value:10.3g}   {gate.low:.4g}..{gate.high:.4g}{verdict}\n")
    if mocap_note == "absent":
        sys.stdout.write(f"{'mocap rows':<{width}}  mocap absent (--mocap FOLDER)\n")
    held = sum(gate.held for gate in gates)
    sys.stdout.write(f"{held} of {len(gates)} gates held by {name!r}.\n")


def quality(avatar: Avatar, xy: Float64Array, ground: FloorMap, style: float) -> dict[str, float]:
    """Quality of one motion."""
    motion = walk(skeleton_of(avatar), xy, ground, np.random.default_rng(0), style)
    return dataclasses.asdict(measure(motion, avatar, ground, xy))


def _worst(name: str, numbers: list[dict[str, float]]) -> Iterator[MotionGate]:
    """Gates of feet, root and knees over some motions."""
    limits = {
        "skate_mean_cmps": 1.0,
        "skate_max_cmps": 5.0,
        "penetration_max_mm": 5.0,
        "hover_max_mm": 10.0,
        "airborne_max_mm": 10.0,
        "root_error_max_cm": 2.0,
        "knee_max_deg": 80.0,
        "joint_speed_max_degps": 1000.0,
    }
    for key, high in limits.items():
        yield MotionGate(f"{name}: {key}", max(quality[key] for quality in numbers), 0.0, high)
    yield MotionGate(f"{name}: knee_min_deg", min(quality["knee_min_deg"] for quality in numbers), 0.5, 80.0)


def path_gates(avatar: Avatar, style: float) -> Iterator[MotionGate]:
    """Worst numbers of every path over its speeds, and of uneven floors."""
    for path, make in PATHS.items():
        numbers = [quality(avatar, make(speed), FLOORS["flat"], style) for speed in SPEEDS_MPS]
        yield from _worst(f"{path} {SPEEDS_MPS[0]}..{SPEEDS_MPS[-1]} m/s", numbers)
    for ground in ("slope 11 %", "bumps 3 cm"):
        numbers = [quality(avatar, make(1.2), FLOORS[ground], style) for make in (line, circle)]
        yield from _worst(f"{ground} 1.2 m/s", numbers)


def steady(avatar: Avatar, speed_mps: float) -> tuple[float, float, float]:
    """Cadence per minute, step length [m] and pelvis oscillation [m] of a steady straight walk."""
    duration_s = 12.0
    motion = walk(skeleton_of(avatar), line(speed_mps, duration_s), FLOORS["flat"], np.random.default_rng(0), 0.0)
    rows = slice(60, 220)
    middle = dataclasses.replace(motion, root_m=motion.root_m[rows], pose_axis_angle=motion.pose_axis_angle[rows])
    cadence = cadence_per_min(middle, avatar)
    return cadence, 60.0 * speed_mps / cadence, float(np.ptp(middle.root_m[:, 2]))


def steady_gates(avatar: Avatar) -> Iterator[MotionGate]:
    """Cadence and step length against the fits to 207 walks, and the pelvis' oscillation."""
    size = skeleton_of(avatar).size
    for speed in STEADY_SPEEDS_MPS:
        cadence, step_m, _ = steady(avatar, speed)
        scaled = speed / np.sqrt(size)
        fit_per_min, fit_m = (66.4 + 38.9 * scaled) / np.sqrt(size), (0.158 + 0.417 * scaled) * size
        yield MotionGate(f"cadence_per_min at {speed} m/s", cadence, 0.9 * fit_per_min, 1.1 * fit_per_min)
        yield MotionGate(f"step_m at {speed} m/s", step_m, 0.9 * fit_m, 1.1 * fit_m)
    yield MotionGate("pelvis_oscillation_cm at 1.2 m/s", 100.0 * steady(avatar, 1.2)[2], 2.5, 4.5)


def flight_share(avatar: Avatar, speed_mps: float) -> float:
    """Share of a steady run in which no foot is on the floor."""
    motion = walk(skeleton_of(avatar), line(speed_mps), FLOORS["flat"], np.random.default_rng(0), 0.0)
    heights = heights_above(sole_points(*joints_of(motion, avatar), skeleton_of(avatar)), FLOORS["flat"])
    share: float = np.mean(heights[60:160].min(axis=(1, 2)) > FLIGHT_M)
    return float(share)


def run_gates(avatar: Avatar, style: float) -> Iterator[MotionGate]:
    """Runs: cadence, oscillation, flight, knees and feet; figures of 2.6 to 2.9 m/s are mocap's."""
    size = skeleton_of(avatar).size
    cadence, _, oscillation_m = steady(avatar, 2.9)
    known = 120.0 * float(stride_rate(2.9 / np.sqrt(size), 1.0, 1.0)) / np.sqrt(size)
    yield MotionGate("run cadence_per_min at 2.9 m/s", cadence, 0.9 * 157.0, 1.1 * 157.0)
    yield MotionGate("run cadence beside its own law", cadence / known, 0.97, 1.03)
    yield MotionGate("run pelvis_oscillation_cm at 2.9 m/s", 100.0 * oscillation_m, 8.0, 14.0)
    yield MotionGate("run flight_share at 2.9 m/s", flight_share(avatar, 2.9), 0.15, 0.5)
    numbers = [quality(avatar, dash(speed), FLOORS["flat"], style) for speed in RUN_SPEEDS_MPS]
    worst = {key: max(quality[key] for quality in numbers) for key in numbers[0]}
    for key, low, high in (
        ("skate_mean_cmps", 0.0, 1.0),
        ("skate_max_cmps", 0.0, 10.0),
        ("penetration_max_mm", 0.0, 5.0),
        ("hover_max_mm", 0.0, 10.0),
        ("root_error_max_cm", 0.0, 2.0),
        ("knee_max_deg", 95.0, 125.5),
    ):
        yield MotionGate(f"run {RUN_SPEEDS_MPS[0]}..{RUN_SPEEDS_MPS[-1]} m/s: {key}", worst[key], low, high)


def feature_gates(avatar: Avatar) -> Iterator[MotionGate]:
    """HumanML3D's features of our motions and paths give them back."""
    motion = walk(skeleton_of(avatar), s_curve(1.2), FLOORS["flat"], np.random.default_rng(0))
    joints = yup_from_zup(joints_of(motion, avatar)[1])[:, :22]
    features, start = encode(joints)
    error_m = float(np.abs(decode_joints(features, start) - joints[:-1]).max())
    yield MotionGate("features -> joints_m", error_m, 0.0, 1e-5)
    xy = s_curve(1.2)
    x, z, psi = xy[:, 0], -xy[:, 1], np.cumsum(np.full(len(xy), 0.01))
    rows = np.concatenate([encode_path(x, z, psi), np.zeros((1, 3))])
    back = decode_path(rows, Start(float(x[0]), float(z[0]), float(psi[0])))
    yield MotionGate("path -> features -> path", float(np.abs(back - np.stack([x, z, psi], axis=1)).max()), 0.0, 1e-9)


def mocap_gates(avatar: Avatar, folder: Path) -> Iterator[MotionGate]:
    """Leg curves and jerk beside CMU mocap; runs may be further from their one short clip."""
    for name, numbers in compare_all(avatar, folder).items():
        limit_deg = 10.0 if "02_03 by" in name else 6.0
        yield MotionGate(f"CMU {name}: hip_rmse_deg", numbers["hip_rmse_deg"], 0.0, limit_deg)
        yield MotionGate(f"CMU {name}: knee_rmse_deg", numbers["knee_rmse_deg"], 0.0, limit_deg)
        yield MotionGate(f"CMU {name}: jerk_mean_ratio", numbers["jerk_mean_ratio"], 0.0, 1.5)
        yield MotionGate(f"CMU {name}: jerk_p99_ratio", numbers["jerk_p99_ratio"], 0.0, 1.5)


def cost_ms(avatar: Avatar, repetitions: int = 15) -> float:
    """CPU time of a motion of 10 s [ms], median; nothing is compiled meanwhile."""
    skeleton, xy = skeleton_of(avatar), s_curve(1.2)
    spent = []
    for seed in range(repetitions + 1):
        start = time.thread_time()
        walk(skeleton, xy, FLOORS["flat"], np.random.default_rng(seed))
        spent.append(time.thread_time() - start)
    return float(np.median(spent[1:])) * 1e3
