"""Joint error and cost of the closed-form SMPL fit.

    python -m readygo.benchmarks.motion.smpl_fit [--cmu FOLDER] [--avatar NAME]

Prints JSON: for our own gait, and for every CMU clip (NN.asf, NN_MM.amc) of a folder with the clip's bone lengths, the
distance of the fitted joints from those that were asked for, and the CPU time per frame, the least of several runs.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.benchmarks.motion.cmu import joints_20hz
from readygo.benchmarks.motion.paths import circle, floor, s_curve, stop_and_go
from readygo.common.arrays import Float64Array
from readygo.common.avatars import load_avatars
from readygo.common.frames import yup_from_zup
from readygo.services.animator import skeleton_of, walk
from readygo.services.animator.gait.quality import joints_of
from readygo.services.animator.smpl.fit import PARENTS, fit_rotations, pose_of
from readygo.services.animator.smpl.fit_math import SMALL

RUNS = 7
PATHS = {"s_curve": s_curve, "circle_r1.5": circle, "stop_and_go": stop_and_go}


def fit_row(joints_m: Float64Array, offsets_m: Float64Array) -> dict[str, float]:
    """Numbers of one motion: joints 0..21 in y-up axes [m], shape (T, 22, 3)."""
    best_s = np.inf
    for _ in range(RUNS + 1):
        start_s = time.thread_time()
        G, X = fit_rotations(joints_m, offsets_m)
        pose_of(G)
        best_s = min(best_s, time.thread_time() - start_s)
    error_mm = 1e3 * np.linalg.norm(X[:, :22] - joints_m, axis=2)
    return {
        "rows": len(joints_m),
        "error_mean_mm": round(float(error_mm.mean()), 3),
        "error_max_mm": round(float(error_mm.max()), 3),
        "ms_per_frame": round(1e3 * best_s / len(joints_m), 4),
    }


def bone_offsets(joints_m: npt.ArrayLike, template_m: npt.ArrayLike, *, rounds: int = 3) -> Float64Array:
    """A body with the bone lengths of given joints.

    Lengths are medians over time. Pelvis and chest carry several bones: their directions are averages in the frame that
    the fit finds.

    Args:
        joints_m: Positions in y-up axes [m], shape (T, 22 or 24, 3).
        template_m: A body's T-pose offsets [m], shape (24, 3), for directions and for what the joints do not show.
        rounds: Fits from which the directions are averaged.

    Returns:
        T-pose offsets [m], shape (24, 3).
    """
    P = np.asarray(joints_m, dtype=np.float64)
    offsets = np.array(template_m, dtype=np.float64)
    children = np.arange(1, P.shape[1])
    bones = P[:, children] - P[:, PARENTS[children]]
    length = np.median(np.sqrt(np.sum(bones * bones, axis=2)), axis=0)
    before = np.sqrt(np.sum(offsets * offsets, axis=1))
    offsets[children] *= (length / np.maximum(before[children], SMALL))[:, None]
    for _ in range(rounds):
        G, _ = fit_rotations(P, offsets)
        for joint in (1, 2, 3, 12, 13, 14):
            mean = np.zeros(3)
            for row in range(len(P)):
                mean += G[row, PARENTS[joint]].T @ bones[row, joint - 1]
            offsets[joint] = mean / len(P)
    return offsets


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--avatar", help="embedded avatar whose body walks and gives bone directions")
    parser.add_argument("--cmu", type=Path, help="folder of Acclaim files")
    options = parser.parse_args()
    avatars = load_avatars()
    avatar = avatars[options.avatar or sorted(avatars)[0]]
    skeleton = skeleton_of(avatar)
    results = {}
    for name, path in PATHS.items():
        motion = walk(skeleton, path(1.2), floor(), np.random.default_rng(0))
        P = joints_of(motion, avatar)[1][:, :22]
        results[f"gait {name}"] = fit_row(yup_from_zup(P), skeleton.offsets_m)
    for clip in sorted(options.cmu.glob("*.amc")) if options.cmu else []:
        subject, number = clip.stem.split("_")
        joints, _ = joints_20hz(options.cmu, subject, number)
        results[f"CMU {clip.stem}"] = fit_row(joints, bone_offsets(joints, skeleton.offsets_m))
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
