"""Gate numbers of the gait and what a motion costs: `python benchmarks/motion.py [--avatar NAME] [--out FILE]`.

Prints JSON. Times are CPU time of the thread, the median over repetitions after a warm-up, for motions of 10 s.
"""

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.avatars import Avatar, load_avatars
from common.maps.grid import FloorMap
from services.animator import AnimatorConfig, measure, skeleton_of, walk
from services.animator.quality import cadence_per_min
from benchmarks.motion_paths import Array, circle, floor, line, s_curve, stop_and_go

PATHS = {"straight": line, "circle_r1.5": circle, "s_curve": s_curve, "stop_and_go": stop_and_go}
SPEEDS_MPS = (0.4, 0.8, 1.2, 1.4, 1.6, 2.0)
FLOORS = {
    "flat": floor(),
    "slope_11pct": floor(lambda x, y: 0.10 * x + 0.05 * y),
    "bumps_3cm": floor(lambda x, y: 0.03 * np.sin(2.0 * x) * np.cos(1.5 * y)),
}


def gates(avatar: Avatar, xy: Array, ground: FloorMap, style: float) -> dict[str, float]:
    """Quality of one motion."""
    config = AnimatorConfig(style_variation=style)
    motion = walk(skeleton_of(avatar), xy, ground, np.random.default_rng(0), config)
    return {name: round(value, 3) for name, value in dataclasses.asdict(measure(motion, avatar, ground, xy)).items()}


def steady(avatar: Avatar, speed_mps: float) -> dict[str, float]:
    """Cadence, step length and pelvis oscillation of a steady walk beside the fits to mocap."""
    config = AnimatorConfig(style_variation=0.0)
    skeleton = skeleton_of(avatar)
    motion = walk(skeleton, line(speed_mps, 14.0), FLOORS["flat"], np.random.default_rng(0), config)
    rows = slice(40, 260)
    middle = dataclasses.replace(motion, root_m=motion.root_m[rows], pose_axis_angle=motion.pose_axis_angle[rows])
    cadence, scaled = cadence_per_min(middle, avatar), speed_mps / np.sqrt(skeleton.size)
    numbers = {
        "cadence_per_min": cadence,
        "cadence_fit_per_min": (66.4 + 38.9 * scaled) / np.sqrt(skeleton.size),
        "step_m": 60.0 * speed_mps / cadence,
        "step_fit_m": (0.158 + 0.417 * scaled) * skeleton.size,
        "pelvis_oscillation_cm": float(np.ptp(middle.root_m[:, 2])) * 100.0,
    }
    return {name: round(float(value), 3) for name, value in numbers.items()}


def cost_ms(avatar: Avatar, repetitions: int = 15) -> float:
    """CPU time of a motion of 10 s [ms]."""
    skeleton, config = skeleton_of(avatar), AnimatorConfig()
    xy = s_curve(1.2)
    spent = []
    for seed in range(repetitions + 1):
        start = time.thread_time()
        walk(skeleton, xy, FLOORS["flat"], np.random.default_rng(seed), config)
        spent.append(time.thread_time() - start)
    return round(float(np.median(spent[1:])) * 1e3, 2)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--avatar", help="embedded avatar, or a path to an avatar file")
    parser.add_argument("--style", type=float, default=1.0, help="style variation, 0..1")
    parser.add_argument("--out", type=Path, help="write the JSON to this file too")
    options = parser.parse_args()
    embedded = not options.avatar or not options.avatar.endswith(".npz")
    avatars = load_avatars() if embedded else load_avatars(Path(options.avatar))
    name = options.avatar if embedded and options.avatar else sorted(avatars)[0]
    avatar = avatars[name]
    results: dict[str, Any] = {"avatar": name, "ms_per_10s": cost_ms(avatar)}
    results["steady"] = {f"{speed}": steady(avatar, speed) for speed in SPEEDS_MPS}
    results["gates"] = {
        f"{path} {speed} m/s": gates(avatar, make(speed), FLOORS["flat"], options.style)
        for path, make in PATHS.items()
        for speed in SPEEDS_MPS
    }
    results["floors at 1.2 m/s"] = {
        f"{path} {ground}": gates(avatar, make(1.2), FLOORS[ground], options.style)
        for path, make in PATHS.items()
        for ground in ("slope_11pct", "bumps_3cm")
    }
    text = json.dumps(results, indent=1)
    print(text)
    if options.out:
        options.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
