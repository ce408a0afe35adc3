"""Trainings with and without losses of surfaces or depth images: held-out images, depths of floor and walls, cost.

    readygo scene capture SCENE --walk --marker-size-m 0.2 --out out/walk.mp4
    readygo scene poses out/walk.mp4 --marker-size-m 0.2 --out out/lobby
    python -m experiments.reconstruction.surfaces_and_plain out/walk.truth.json out/lobby/posed --out out/both

All use the preset `draft`. With `--depths 0 0.5` one does without the poses' depth images, and one more for each weight
of `geometry.depth`; all have losses of surfaces then. Run the command again to resume: trainings continue from their
last state, and finished ones stay.
Depths are those of the Gaussians' planes from each n-th camera, before anything is cleaned away, against those of the
filmed scene. Seconds are the trainings' own, by the clock.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from experiments.reconstruction.surfaces import HEIGHT_PX, HFOV_DEG, OUTPUTS, WIDTH_PX, off_surfaces, plane_depths
from readygo.apps.capture.truth import Truth, read_truth
from readygo.benchmarks.rasterizer.render import machine
from readygo.common.arrays import Float64Array
from readygo.common.camera import CameraConfig
from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.files import read_gaussians
from readygo.common.rasterizer.interface import View
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene, load_scene
from readygo.services.reconstructor.frames.masks import FOLDER as MASKS
from readygo.services.reconstructor.poses.colmap import pinhole_views
from readygo.services.reconstructor.training.config import GaussiansConfig, preset
from readygo.services.reconstructor.training.progress import TrainingProgress
from readygo.services.reconstructor.training.train import CLOUD_FILE, train_gaussians
from readygo.services.renderer import Renderer, RendererConfig

WITHOUT = "without depth"


def main(
    truth: Path,
    posed: Path,
    /,
    *,
    out: Path,
    steps: int = 3000,
    side_px: int = 160,
    every: int = 6,
    depths: tuple[float, ...] = (),
    transients: bool = True,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Train, and measure.

    Args:
        truth: NAME.truth.json beside the capture.
        posed: Folder with images/ and sparse/0 of its poses.
        out: Folder of the trainings; earlier trainings are resumed.
        steps: Steps of the optimiser.
        side_px: Longer side of the images.
        every: Depths are compared from each n-th camera.
        depths: Weights of the loss of depth images; empty compares surfaces and plain.
        transients: False leaves out the search for what moved.
        json_output: Print JSON.
    """
    known = read_truth(truth)
    filmed = load_scene(Path(known.content["scene"]["path"]))
    pairs = camera_pairs(known, posed)[::every]
    rows = []
    for what, config in settings(steps, side_px, depths).items():
        source = without_depths(posed, out / "posed") if what == WITHOUT else posed
        report = train_gaussians(source, out / what, replace(config, transients=transients), _say)
        cloud = read_gaussians(out / what / CLOUD_FILE)
        numbers = {name: report[name] for name in ("psnr_db", "ssim", "gaussians", "seconds")}
        rows.append({"what": what, **numbers, **plane_errors(filmed, cloud, pairs)})
    result = {"machine": machine(), "steps": steps, "side_px": side_px, "views": len(pairs), "rows": rows}
    print(json.dumps(result) if json_output else "\n".join(map(str, rows)))


def settings(steps: int, side_px: int, depths: Sequence[float] = ()) -> dict[str, GaussiansConfig]:
    """The trainings: with surfaces and without; or without depth images, and with them at some weights."""
    surfaces = replace(preset("draft"), steps=steps, side_max_px=side_px)
    if depths:
        weighed = {f"depth {w:g}": replace(surfaces, geometry=replace(surfaces.geometry, depth=w)) for w in depths}
        return {WITHOUT: surfaces, **weighed}
    return {"surfaces": surfaces, "plain": replace(surfaces, geometry=replace(surfaces.geometry, enabled=False))}


def without_depths(posed: Path, folder: Path) -> Path:
    """A folder that leads to the same images and poses, and has no depth images."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("images", "sparse", MASKS):
        if (posed / name).is_dir() and not (folder / name).exists():
            (folder / name).symlink_to((posed / name).resolve())
    return folder


def camera_pairs(truth: Truth, posed: Path) -> list[tuple[Float64Array, Float64Array]]:
    """The true pose and the found one of each image that has both, shape (4, 4) each.

    Raises:
        SceneError: If there are none.
    """
    views = pinhole_views(posed / "sparse" / "0")
    found = dict(zip(views.images, views.T_world_camera, strict=True))
    names = sorted(set(truth.poses) & set(found))
    if not names:
        raise SceneError(f"{posed} has no cameras of this capture.")
    return [(truth.poses[name], found[name]) for name in names]


def plane_errors(
    filmed: Scene, cloud: GaussianCloud, pairs: list[tuple[Float64Array, Float64Array]]
) -> dict[str, float]:
    """Median and 90th percentile of the depths' errors on floor and walls [m]."""
    camera = CameraConfig(height_px=HEIGHT_PX, width_px=WIDTH_PX, horizontal_fov_deg=HFOV_DEG)
    config = RendererConfig(human_light=False, feet_on_floor=False, outputs=OUTPUTS)
    rasterizer = Renderer(filmed, {}, RobotConfig(camera=camera), config).rasterizers[""]
    parts = [
        off_surfaces(
            rasterizer.render([View(T_world_camera=true)], OUTPUTS)[0], true, plane_depths(cloud, ours, camera)
        )
        for true, ours in pairs
    ]
    errors: dict[str, float] = {}
    for name in parts[0]:
        off_m = np.concatenate([part[name] for part in parts])
        errors[f"{name}_median_m"] = round(float(np.median(off_m)), 4)
        errors[f"{name}_p90_m"] = round(float(np.quantile(off_m, 0.9)), 4)
    return errors


def _say(at: TrainingProgress) -> None:
    if at.step % 100 == 0:
        sys.stderr.write(f"step {at.step} of {at.steps}, {at.gaussians:,} Gaussians\n")


if __name__ == "__main__":
    tyro.cli(main)
