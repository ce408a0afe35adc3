"""What people who walk through a capture leave in its reconstruction: PSNR of what stands still, ghosts in the map.

readygo scene capture SCENE --walk --people 2 --out out/walk.mp4
readygo reconstruct out/walk.mp4 --marker-size-m 0.2 --out out/lobby
python -m experiments.reconstruction.passers_by SCENE out/walk.truth.json out/lobby [--masks out/walk.masks] [--json]

The masks are the true ones: pixels of people do not count. Without them, all pixels do.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reconstruction.rows import print_row
from readygo.apps.capture.truth import Truth, read_truth
from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.documents import read_json
from readygo.common.gaussians.files import read_gaussians
from readygo.common.maps.distance import clearance_m
from readygo.common.maps.grid import GridFrame, OccupancyMap
from readygo.common.maps.ros_map import load_unknown_cells
from readygo.common.scenes import load_scene
from readygo.common.scenes.filmed import FILMED_MIN
from readygo.services.reconstructor import umeyama
from readygo.services.reconstructor.frames.masks import prepare_masks
from readygo.services.reconstructor.job import FRAMES, MAP, POSED
from readygo.services.reconstructor.poses import undistortion
from readygo.services.reconstructor.reconstruct import CLOUD_FILE, GAUSSIANS
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photos import PhotoStore, Posed, open_posed, split_views
from readygo.services.reconstructor.training.score import measure
from readygo.services.reconstructor.training.train import REPORT_FILE

CLEARANCE_M = 0.3
"""An obstacle of the reconstructed map is a ghost if no true one is within this distance [m]."""


def measured(scene: Path, truth: Path, out: Path, masks: Path | None) -> dict[str, Any]:
    """Scores of the held-out images, and ghosts in the map.

    Args:
        scene: The scene that the capture shows.
        truth: Ground truth of the capture.
        out: Bundle of `readygo reconstruct`, with OUT.work beside it.
        masks: True masks of the capture's images; None: all pixels count.
    """
    work = out.with_name(f"{out.name}.work")
    with tempfile.TemporaryDirectory() as scratch:
        posed = open_posed(work / POSED, Path(scratch) / "undistorted")
        counted = replace(posed, masks=None if masks is None else true_masks(work, masks, Path(scratch)))
        scores = static_scores(counted, work / GAUSSIANS)
    return {**scores, **ghosts(posed, read_truth(truth), load_scene(scene).maps.robot, out)}


def true_masks(work: Path, masks: Path, scratch: Path) -> Path:
    """The true masks, undistorted by the lens that the reconstruction found: a folder of NAME.png."""
    found = read_json(work / FRAMES / "stage.json")["found"]
    prepare_masks(masks, work / FRAMES, found["names"], {}, scratch / "used")
    (scratch / "sparse").symlink_to((work / POSED / "sparse").resolve())
    model = read_json(work / MAP / "stage.json")["found"]["model"]
    undistortion.write_undistorted_masks(work / MAP / model, scratch / "used", scratch)
    return scratch / "masks"


def static_scores(posed: Posed, training: Path) -> dict[str, Any]:
    """PSNR and SSIM of the held-out images where their masks count."""
    report = read_json(training / REPORT_FILE)
    settings = report["settings"]
    held = split_views(posed.moments, settings["hold_out"])[1]
    gaussians = Gaussians.of_cloud(read_gaussians(training / CLOUD_FILE))
    scores = measure(gaussians, PhotoStore(posed, held, settings["side_max_px"], 1), settings["sh_degree"])
    means = {
        name: np.mean([getattr(score, name) for score in scores]) for name in ("psnr_db", "psnr_fitted_db", "ssim")
    }
    return {
        **{name: round(float(value), 3) for name, value in means.items()},
        "held_out": len(scores),
        "gaussians": len(gaussians),
    }


def ghosts(posed: Posed, truth: Truth, true: OccupancyMap, found: Path) -> dict[str, Any]:
    """What the reconstructed map has where it was filmed and the true one is free for `CLEARANCE_M` around: areas [m2].

    Args:
        posed: Poses that the reconstruction found.
        truth: The true ones.
        true: Map of the scene that was filmed.
        found: Bundle of the reconstruction.
    """
    poses = dict(zip(posed.views.images, posed.views.T_world_camera[:, :3, 3], strict=True))
    names = sorted(set(truth.poses) & set(poses))
    p_found, p_true = np.array([poses[name] for name in names]), np.array([truth.poses[name][:3, 3] for name in names])
    free_m = cell_centres_m(true.frame, clearance_m(true) > CLEARANCE_M)
    on_floor = np.column_stack([free_m, np.full(len(free_m), p_true[:, 2].min())])
    places_m = umeyama(p_true, p_found).apply(on_floor)[:, :2]
    maps, unknown = load_scene(found).maps, load_unknown_cells(found / "maps" / "robot.yaml")
    reconstructed, share = maps.robot, maps.filmed_share
    frame, (height, width) = reconstructed.frame, reconstructed.occupied.shape
    column, row = np.floor((places_m - [frame.origin_x_m, frame.origin_y_m]) / frame.resolution_m).astype(np.int64).T
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    row, column = row[inside], column[inside]
    known = ~unknown[row, column] & (True if share is None else share[row, column] >= FILMED_MIN)
    occupied, cell_m2 = reconstructed.occupied[row, column] & known, true.frame.resolution_m**2
    return {
        "ghost_cells": int(occupied.sum()),
        "ghosts_m2": round(float(occupied.sum()) * cell_m2, 3),
        "free_m2": round(float((known & ~occupied).sum()) * cell_m2, 2),
    }


def cell_centres_m(frame: GridFrame, cells: BoolArray) -> Float64Array:
    """World x, y of the centres of the cells that are true [m], shape (N, 2)."""
    rows, columns = np.nonzero(cells)
    centres: Float64Array = np.array([frame.origin_x_m, frame.origin_y_m]) + frame.resolution_m * (
        np.stack([columns, rows], 1) + 0.5
    )
    return centres


def main() -> int:
    """Print the scores; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="scene that the capture shows")
    parser.add_argument("truth", type=Path, help="NAME.truth.json beside the capture")
    parser.add_argument("out", type=Path, help="bundle of `readygo reconstruct`, with OUT.work beside it")
    parser.add_argument("--masks", type=Path, help="true masks of the capture, NAME.masks")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    scene, truth, out, masks = arguments.scene, arguments.truth, arguments.out, arguments.masks
    return print_row(lambda: measured(scene, truth, out, masks), as_json=arguments.json)


if __name__ == "__main__":
    sys.exit(main())
