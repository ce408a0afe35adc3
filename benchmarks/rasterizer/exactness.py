"""Images of the CPU rasterizer against the reference.

    python -m readygo.benchmarks.rasterizer.exactness SCENE... [--views 50] [--json]

Views are drawn from random standpoints in the scene's free area. The rules leave the order of equal depths open
(`readygo.common.rasterizer.constants`), and files with quantised coordinates hold many Gaussians of exactly equal
depth, so the reference takes the Gaussians in the order in which they are packed. What is left are near ties: depths
that differ by less than float32 can tell.

A pixel off by more than 2/255 lies at a near tie if Gaussians that it shows have depths within `NEAR_TIE` (relative)
and drawing these in another order can move its colour by as much. Exits with 1 if another pixel is off, or a view is
below 60 dB.
"""

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from readygo.benchmarks.rasterizer.footprints import Footprints, PixelStack, footprints, pixel_stack
from readygo.benchmarks.rasterizer.scenery import random_places, scene_scenery, walk_motion
from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import load_avatars, pose_avatar
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.rasterizer.packed.scene import morton_codes
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.common.rasterizer.warm import warm
from readygo.common.robot import CameraConfig
from readygo.common.scenes import Scene, load_scene

OFF = 2 / 255
NEAR_TIE = 1e-6
"""Relative difference of depths."""
ELSE_DIFFERENT = 0.5 / 255
"""What may be different in a pixel apart from its near ties."""
PSNR_MIN_DB = 60.0


@dataclass(frozen=True, kw_only=True)
class ViewError:
    """How one view differs."""

    psnr_db: float
    max_difference: float
    """Largest difference of a value, in steps of 1/255."""
    values_off: int
    """Values (of height x width x 3) off by more than 2/255."""
    pixels_off: int
    """Pixels with such a value."""
    pixels_off_at_near_ties: int
    """Those of them where Gaussians are nearly equally deep and their order matters."""


def main(
    scenes: tuple[Path, ...],
    /,
    *,
    views: int = 50,
    people: int = 0,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Compare.

    Args:
        scenes: Scene bundles.
        views: Camera poses per scene.
        people: Embedded avatars in front of the camera.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    warm()
    results = {path.name: scene_errors(load_scene(path), views, people, seed) for path in scenes}
    if json_output:
        print(json.dumps({name: summary(errors) | {"per_view": list(map(asdict, errors))} for name, errors in
                          results.items()}))  # fmt: skip
    else:
        for name, errors in results.items():
            print("\n".join(f"{key:28s} {value}" for key, value in ({"scene": name} | summary(errors)).items()))
    sys.exit(0 if all(summary(errors)["passed"] for errors in results.values()) else 1)


def scene_errors(scene: Scene, views: int, people: int = 0, seed: int = 0) -> list[ViewError]:
    """Errors of views from random standpoints.

    Args:
        scene: Bundle.
        views: How many.
        people: Embedded avatars in front of the camera.
        seed: Seed of the standpoints.
    """
    scenery, camera = scene_scenery(scene), CameraConfig()
    avatars = dict(list(load_avatars().items())[:people])
    motions = {name: walk_motion(avatar, None, seed) for name, avatar in avatars.items()}
    rasterizer = CpuRasterizer(scenery.layers(), avatars, camera.K_px, camera.height_px, camera.width_px)
    layers = [in_packed_order(cloud) for cloud in (scene.cloud, scene.sky) if cloud is not None]
    errors = []
    for place in random_places(scenery, people, views, seed):
        T = place.T_world_camera(camera, 0)
        posed = [
            _pose(name, motion.root_m[40], motion.pose_axis_angle[40], place.humans_m[number])
            for number, (name, motion) in enumerate(motions.items())
        ]
        bodies = [pose_avatar(avatars[p.avatar], p.root_m, p.pose_axis_angle) for p in posed]
        cloud = concatenate([*layers, *bodies])
        errors.append(view_error(rasterizer.render_float(View(T_world_camera=T, humans=posed)), cloud, T, camera))
    return errors


def _pose(name: str, root_m: Float32Array, pose: Float32Array, standpoint_m: Sequence[float]) -> PosedHuman:
    x_m, y_m, floor_m = standpoint_m
    return PosedHuman(avatar=name, root_m=np.array([x_m, y_m, floor_m + root_m[2]]), pose_axis_angle=pose)


def in_packed_order(cloud: GaussianCloud) -> GaussianCloud:
    """The Gaussians that the CPU rasterizer keeps, in the order in which it draws those of equal depth."""
    kept = cloud.select(np.flatnonzero(cloud.opacities >= np.float32(ALPHA_MIN)))
    return kept.select(np.argsort(morton_codes(kept.means_m), kind="stable"))


def view_error(image: Float32Array, cloud: GaussianCloud, T: Float64Array, camera: CameraConfig) -> ViewError:
    """Compare an image with the reference's image of a cloud.

    Args:
        image: Colours 0..1, may exceed 1, shape (H, W, 3).
        cloud: What it shows.
        T: Camera pose, shape (4, 4).
        camera: Intrinsics and size.
    """
    height, width = image.shape[:2]
    reference = rasterize_reference(cloud, T, camera.K_px, height, width).rgb
    error = np.clip(image, 0.0, 1.0).astype(np.float64) - np.clip(reference, 0.0, 1.0)
    pixels = np.argwhere(np.abs(error).max(axis=2) > OFF)
    tied = 0
    if len(pixels):
        prints = footprints(cloud, T, camera.K_px, height, width)
        tied = sum(_lies_at_near_tie(prints, cloud, T, error, int(row), int(column)) for row, column in pixels)
    return ViewError(
        psnr_db=round(-10 * math.log10(max(float((error**2).mean()), 1e-20)), 2),
        max_difference=round(255 * float(np.abs(error).max()), 3),
        values_off=int((np.abs(error) > OFF).sum()),
        pixels_off=len(pixels),
        pixels_off_at_near_ties=tied,
    )


def _lies_at_near_tie(
    prints: Footprints, cloud: GaussianCloud, T: Float64Array, error: Float64Array, row: int, column: int
) -> bool:
    reorder = largest_change_by_order(pixel_stack(prints, cloud, T, row, column))
    return bool((np.abs(error[row, column]) <= reorder + ELSE_DIFFERENT).all())


def largest_change_by_order(stack: PixelStack) -> Float64Array:
    """Bound on how far a pixel's colour moves if Gaussians of nearly equal depth change places, shape (3,).

    Exchanging neighbours i and j changes it by T a_i a_j (c_i - c_j), T being the transmittance before them, and any
    order of a group comes from exchanging each pair at most once.
    """
    change = np.zeros(3)
    gaps = np.diff(stack.depth_m) >= NEAR_TIE * stack.depth_m[1:]
    for group in np.split(np.arange(len(stack.index)), np.flatnonzero(gaps) + 1):
        for place, i in enumerate(group):
            for j in group[place + 1 :]:
                weight = stack.transmittance[group[0]] * stack.alpha[i] * stack.alpha[j]
                change += weight * np.abs(stack.rgb[i] - stack.rgb[j])
    return change


def summary(errors: list[ViewError]) -> dict[str, Any]:
    """Figures over all views, and whether they meet the target."""
    psnr_db = [error.psnr_db for error in errors]
    off = sum(error.pixels_off for error in errors)
    tied = sum(error.pixels_off_at_near_ties for error in errors)
    return {
        "views": len(errors),
        "psnr_min_db": min(psnr_db),
        "psnr_median_db": round(float(np.median(psnr_db)), 2),
        "max_difference_of_255": max(error.max_difference for error in errors),
        "values_off_by_more_than_2": sum(error.values_off for error in errors),
        "pixels_off": off,
        "pixels_off_at_near_ties": tied,
        "passed": min(psnr_db) >= PSNR_MIN_DB and off == tied,
    }


if __name__ == "__main__":
    tyro.cli(main)
