"""Voxelization of Gaussians beside simpler rules.

    python -m experiments.planning.voxels [SCENE ...] [--gaussians 1000000]

Without scenes a synthetic floor of 20 x 20 m with walls and clutter is voxelized. All rules add a Gaussian's opacity to
voxels; the exact ones to those that its 1-sigma ellipsoid touches. Times are CPU time of one thread, the shortest of
`--runs`; voxels count as occupied above the threshold of maps.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.covariance import covariance_of
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame, MapConfig, opacity_sums
from readygo.common.maps.voxels import SCALE_MIN_M
from readygo.runs.scene_argument import open_scene

BOX, ALIGNED, MEAN = 0, 1, 2
PEERS = {"box_test": BOX, "axis_aligned_box": ALIGNED, "means_only": MEAN}
"""Exact test of every voxel; all voxels of the ellipsoid's axis-aligned box; the voxel of the mean."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """What is voxelized, and where."""

    name: str
    cloud: GaussianCloud
    frame: GridFrame
    bottom_m: float
    shape: tuple[int, int, int]


@kernel_with_cache(inline="always")
def _least_on_rectangle(A: float, B: float, C: float, a0: float, a1: float, b0: float, b1: float) -> float:
    """Minimum of A a^2 + 2 B a b + C b^2 over a rectangle."""
    inside_a, inside_b = a0 <= 0.0 <= a1, b0 <= 0.0 <= b1
    if inside_a and inside_b:
        return 0.0
    best = np.inf
    if not inside_a:
        a = a0 if a0 > 0 else a1
        b = min(max(-B * a / C, b0), b1)
        best = A * a * a + 2 * B * a * b + C * b * b
    if not inside_b:
        b = b0 if b0 > 0 else b1
        a = min(max(-B * b / A, a0), a1)
        best = min(best, A * a * a + 2 * B * a * b + C * b * b)
    return best


@kernel_with_cache(inline="always")
def _least_on_face(
    x: float, p_xx: float, p_xy: float, p_xz: float, p_yy: float, p_yz: float, p_zz: float, y: tuple, z: tuple
) -> float:
    """Minimum of the quadratic form P over the face of a box where one coordinate is `x`."""
    det = p_yy * p_zz - p_yz * p_yz
    cy, cz = (p_xz * p_yz - p_xy * p_zz) * x / det, (p_xy * p_yz - p_xz * p_yy) * x / det
    base = x * (p_xx * x + p_xy * cy + p_xz * cz)
    return base + _least_on_rectangle(p_yy, p_yz, p_zz, y[0] - cy, y[1] - cy, z[0] - cz, z[1] - cz)


@kernel_with_cache
def _least_in_box(P: tuple, x: tuple, y: tuple, z: tuple) -> float:
    """Minimum of v^T P v over a box; on one of the at most three faces that part it from the origin."""
    p_xx, p_xy, p_xz, p_yy, p_yz, p_zz = P
    best = np.inf
    if not x[0] <= 0.0 <= x[1]:
        best = _least_on_face(x[0] if x[0] > 0 else x[1], p_xx, p_xy, p_xz, p_yy, p_yz, p_zz, y, z)
    if not y[0] <= 0.0 <= y[1]:
        best = min(best, _least_on_face(y[0] if y[0] > 0 else y[1], p_yy, p_xy, p_yz, p_xx, p_xz, p_zz, x, z))
    if not z[0] <= 0.0 <= z[1]:
        best = min(best, _least_on_face(z[0] if z[0] > 0 else z[1], p_zz, p_xz, p_yz, p_xx, p_xy, p_yy, x, y))
    return 0.0 if best == np.inf else best


@kernel_with_cache
def _peer_sums(means, quats, scales, opacities, origin, h, rule, sums):
    """Opacity sums by one of the rules of PEERS."""
    nz, ny, nx = sums.shape
    for n in range(len(means)):
        X, Y, Z = means[n, 0] - origin[0], means[n, 1] - origin[1], means[n, 2] - origin[2]
        if rule == MEAN:
            k, j, i = math.floor(Z / h), math.floor(Y / h), math.floor(X / h)
            if 0 <= k < nz and 0 <= j < ny and 0 <= i < nx:
                sums[k, j, i] += opacities[n]
            continue
        s0, s1, s2 = max(scales[n, 0], SCALE_MIN_M), max(scales[n, 1], SCALE_MIN_M), max(scales[n, 2], SCALE_MIN_M)
        q0, q1, q2, q3 = quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3]
        S = covariance_of(q0, q1, q2, q3, s0, s1, s2)
        P = covariance_of(q0, q1, q2, q3, 1.0 / s0, 1.0 / s1, 1.0 / s2)
        ex, ey, ez = math.sqrt(S[0]), math.sqrt(S[3]), math.sqrt(S[5])
        i0, i1 = max(0, math.floor((X - ex) / h)), min(nx - 1, math.floor((X + ex) / h))
        j0, j1 = max(0, math.floor((Y - ey) / h)), min(ny - 1, math.floor((Y + ey) / h))
        k0, k1 = max(0, math.floor((Z - ez) / h)), min(nz - 1, math.floor((Z + ez) / h))
        exact = rule == BOX and (i1 > i0 or j1 > j0 or k1 > k0)
        for k in range(k0, k1 + 1):
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    x, y, z = (i * h - X, (i + 1) * h - X), (j * h - Y, (j + 1) * h - Y), (k * h - Z, (k + 1) * h - Z)
                    if exact and _least_in_box(P, x, y, z) > 1.0:
                        continue
                    sums[k, j, i] += opacities[n]


def peer_sums(ground: Ground, rule: int) -> Float32Array:
    """Opacity sums by one of the rules of PEERS."""
    sums, cloud = np.zeros(ground.shape, np.float32), ground.cloud
    origin = (float(ground.frame.origin_x_m), float(ground.frame.origin_y_m), float(ground.bottom_m))
    arrays = cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities
    _peer_sums(*arrays, origin, float(ground.frame.resolution_m), rule, sums)
    return sums


def own_sums(ground: Ground) -> Float32Array:
    """Opacity sums by the product's rule."""
    return opacity_sums(ground.cloud, ground.frame, ground.bottom_m, ground.shape)


def synthetic_ground(count: int, seed: int) -> Ground:
    """A third floor, a third walls, a third clutter; flat Gaussians of 2 cm with a long tail, in no order."""
    rng = np.random.default_rng(seed)
    means, kind = rng.uniform(0, (20.0, 20.0, 3.0), (count, 3)), rng.integers(0, 3, count)
    means[kind == 0, 2] = rng.normal(0.05, 0.02, np.count_nonzero(kind == 0))
    walls = kind == 1
    means[walls, 0] = np.round(means[walls, 0] / 4) * 4 + rng.normal(0, 0.02, np.count_nonzero(walls))
    scales = np.clip(np.exp(rng.normal(math.log(0.018), 0.8, (count, 3))), 1e-3, 1.0)
    scales[np.arange(count), rng.integers(0, 3, count)] *= 0.1
    cloud = GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=rng.normal(size=(count, 4)).astype(np.float32),
        scales_m=scales.astype(np.float32),
        opacities=rng.beta(1.2, 0.8, count).astype(np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.05)
    return Ground(name=f"synthetic {count}", cloud=cloud, frame=frame, bottom_m=-0.5, shape=(80, 440, 440))


def scene_ground(name: str) -> Ground:
    """A scene's Gaussians within the bounds of its map, from 0.5 m below its lowest floor to 3.5 m above it."""
    scene = open_scene(name)
    occupancy = scene.maps.robot
    bottom_m = float(scene.maps.floor.height_m.min()) - 0.5
    layers = round(4.0 / occupancy.frame.resolution_m)
    shape = (layers, *occupancy.occupied.shape)
    return Ground(name=scene.name, cloud=scene.cloud, frame=occupancy.frame, bottom_m=bottom_m, shape=shape)


def measure(ground: Ground, runs: int) -> dict[str, Any]:
    """Times and errors of all rules; every rule runs once in each round, so that noise meets all of them."""
    rules: dict[str, Callable[[], Float32Array]] = {"rows (readygo)": lambda: own_sums(ground)}
    for name, rule in PEERS.items():
        rules[name] = lambda rule=rule: peer_sums(ground, rule)
    sums = {name: rule() for name, rule in rules.items()}
    seconds: dict[str, list[float]] = {name: [] for name in rules}
    for _ in range(runs):
        for name, rule in rules.items():
            started_s = time.thread_time()
            rule()
            seconds[name].append(time.thread_time() - started_s)
    threshold = MapConfig().opacity_threshold
    truth = sums["box_test"] > threshold
    own_s = min(seconds["rows (readygo)"])
    rows = {}
    for name, spent_s in seconds.items():
        occupied = sums[name] > threshold
        rows[name] = {
            "cpu_s": round(min(spent_s), 4),
            "times_readygo": round(min(spent_s) / own_s, 2),
            "false_voxels": int((occupied & ~truth).sum()),
            "missed_voxels": int((truth & ~occupied).sum()),
            "largest_sum_difference": float(np.abs(sums[name] - sums["box_test"]).max()),
        }
    return {"ground": ground.name, "gaussians": len(ground.cloud), "occupied_voxels": int(truth.sum()), "rules": rows}


def table(result: dict[str, Any]) -> str:
    """The result for people."""
    occupied = max(result["occupied_voxels"], 1)
    lines = [f"{result['ground']}: {result['gaussians']:,} Gaussians, {result['occupied_voxels']:,} voxels occupied"]
    lines.append(f"{'rule':<18}{'CPU s':>8}{'ratio':>8}{'false':>18}{'missed':>18}")
    for name, row in result["rules"].items():
        errors = [f"{row[key]:,} ({100 * row[key] / occupied:.1f} %)" for key in ("false_voxels", "missed_voxels")]
        lines.append(f"{name:<18}{row['cpu_s']:>8.3f}{row['times_readygo']:>8.2f}{errors[0]:>18}{errors[1]:>18}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", help='scene bundles or "embedded"; the synthetic floor by default')
    parser.add_argument("--gaussians", type=int, default=1_000_000, help="of the synthetic floor")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="one JSON object per scene instead of a table")
    arguments = parser.parse_args()
    grounds = map(scene_ground, arguments.scenes) if arguments.scenes else [None]
    for ground in grounds:
        result = measure(ground or synthetic_ground(arguments.gaussians, arguments.seed), arguments.runs)
        sys.stdout.write(json.dumps(result) + "\n" if arguments.json else table(result))


if __name__ == "__main__":
    main()
