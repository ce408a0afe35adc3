"""Poses of simulated captures beside the truth: camera and scale errors, and what the map's own residuals say of them.

readygo scene capture SCENE --walk --out out/walk.mp4
readygo scene poses out/walk.mp4 --marker-size-m 0.2 --out out/lobby
python -m experiments.reconstruction.poses out/walk.truth.json out/lobby [--json]
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reconstruction.rows import print_row
from readygo.apps.capture.compare import pose_errors
from readygo.apps.capture.truth import read_truth
from readygo.common.arrays import Float64Array
from readygo.common.errors import SceneError
from readygo.services.reconstructor.job import POSED, REPORT_FILE
from readygo.services.reconstructor.metric.drift import PoseErrors
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.covariance import pose_errors as pose_errors_of


def measured(truth: Path, job: Path) -> dict[str, Any]:
    """Errors of what `readygo scene poses` left in a folder, and what it said of its scale.

    Raises:
        SceneError: If the folder holds no poses, or those of something else.
    """
    model = colmap.find_model(job / POSED)
    if model is None:
        raise SceneError(f"{job} holds no poses; run `readygo scene poses VIDEO --marker-size-m 0.2 --out {job}`.")
    found = colmap.read_map(model)
    errors = pose_errors(read_truth(truth), dict(zip(found.names, found.T_world_camera, strict=True)))
    report = json.loads((job / POSED / REPORT_FILE).read_text(encoding="utf-8"))
    scale = report["scale"]
    said = {"interval_percent": scale["interval_percent"], "drift_percent": scale.get("drift_percent")}
    residuals = pose_errors_of(model, found.names, PosesConfig())
    by_residuals = round(shape_rmse_m(found.T_world_camera, residuals), 5) if residuals else None
    return {**errors.to_mapping(), "shape_rmse_by_residuals_m": by_residuals, **said, "scale_by": scale["source"]}


def shape_rmse_m(T_world_camera: Float64Array, errors: PoseErrors) -> float:
    """What the residuals of a map say of its cameras' errors that no similarity takes away [m].

    Args:
        T_world_camera: Its poses [m], shape (V, 4, 4).
        errors: Errors of all of them.
    """
    centres = T_world_camera[:, :3, 3]
    R, t = np.swapaxes(T_world_camera[:, :3, :3], 1, 2), -np.einsum("vji,vj->vi", T_world_camera[:, :3, :3], centres)
    # A centre is -R' t: how it moves with a rotation from the left, and with t.
    turned = np.cross(t[:, None, :], np.eye(3))
    moves = -np.concatenate([np.einsum("vji,vkj->vik", R, turned), np.swapaxes(R, 1, 2)], axis=2)
    away = centres - centres.mean(axis=0)
    same = np.eye(3)
    frames = [np.broadcast_to(same[k], away.shape) for k in range(3)]
    frames += [np.cross(same[k], away) for k in range(3)]
    basis = np.linalg.qr(np.stack([column.ravel() for column in (*frames, away)], axis=1))[0]
    count = len(centres)
    blocks = errors.covariance.reshape(count, 6, count, 6)
    covariance = np.einsum("aik,akbl,bjl->aibj", moves, blocks, moves, optimize=True).reshape(3 * count, 3 * count)
    variance = np.trace(covariance) - np.trace(basis.T @ covariance @ basis)
    return float(np.sqrt(variance / count))


def main() -> int:
    """Print the errors; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, help="NAME.truth.json beside the capture")
    parser.add_argument("job", type=Path, help="folder of `readygo scene poses`")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    return print_row(lambda: measured(arguments.truth, arguments.job), as_json=arguments.json)


if __name__ == "__main__":
    sys.exit(main())
