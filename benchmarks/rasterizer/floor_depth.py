"""How far mean and median depth are off the floor that the robot sees before it, by the scene's own floor map.

    python -m readygo.benchmarks.rasterizer.floor_depth scenes/lobby

From random standpoints of the free area, each pixel's ray is followed to the floor map. Pixels count whose ray stays
over free cells and meets the floor within reach; their depths are compared with that place's.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from readygo.benchmarks.rasterizer.scenery import BenchScenery
from readygo.benchmarks.rasterizer.setting import Measurement, open_setting
from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.maps import OccupancyMap
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.robot import CameraConfig

STEP_M = 0.02
"""Step along a ray, in depth."""
NEAREST_M = 0.2
OFF = (0.1, 0.3)
"""Relative errors from which on a depth is called off."""


def main(
    scene: Path,
    /,
    *,
    views: int = 100,
    reach: float = 3.0,
    height_px: int = 72,
    width_px: int = 128,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle.
        views: Camera poses.
        reach: Farthest depth of the floor that counts [m].
        height_px: Image height.
        width_px: Image width.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    job = Measurement(scene=str(scene), avatars=0, height_px=height_px, width_px=width_px, views=views, seed=seed)
    setting = open_setting(job)
    camera, scenery = setting.camera, setting.scenery
    rasterizer = CpuRasterizer(scenery.layers(), {}, camera.K_px, height_px, width_px)
    found: dict[str, list[Float64Array]] = {"mean": [], "median": []}
    for place in setting.places:
        pose = place.T_world_camera(camera, 0)
        true_m = floor_depths(scenery, camera, pose, reach)
        images = rasterizer.render([View(T_world_camera=pose)], ("rgb", "depth", "median_depth"))[0]
        seen = np.isfinite(true_m)
        for name, depth_m in (("mean", images.depth_m), ("median", images.median_depth_m)):
            assert depth_m is not None
            found[name].append(depth_m[seen] / true_m[seen] - 1)
    rows = [{"depth": name, **errors(np.concatenate(parts))} for name, parts in found.items()]
    if json_output:
        print(json.dumps(rows))
        return
    for row in rows:
        off = f"off by more than 10 %: {row['off_10_percent']:.1f} %, than 30 %: {row['off_30_percent']:.1f} %"
        print(f"{row['depth']:6}  {row['pixels']:,} floor pixels, {off}")


def errors(relative: Float64Array) -> dict[str, Any]:
    """Shares of relative errors of depth, shape (N,), that are off [%]; what is not finite is off."""
    bad = {f"off_{round(100 * off)}_percent": ~(np.abs(relative) <= off) for off in OFF}
    return {"pixels": len(relative), **{name: float(100 * np.mean(off)) for name, off in bad.items()}}


def floor_depths(
    scenery: BenchScenery, camera: CameraConfig, T_world_camera: Float64Array, reach_m: float
) -> Float64Array:
    """Depth of the floor map along pixels' rays [m], shape (H, W); NaN where that is not free floor within reach."""
    K = camera.K_px
    u, v = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    rays_C = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1).reshape(-1, 3)
    rays_W = rays_C @ T_world_camera[:3, :3].T
    depth_m, open_ray = np.full(len(rays_W), np.nan), np.ones(len(rays_W), dtype=np.bool_)
    above_m = np.full(len(rays_W), np.inf)
    for t in np.arange(NEAREST_M, reach_m, STEP_M):
        points = T_world_camera[:3, 3] + t * rays_W
        height_m = points[:, 2] - scenery.floor.at_many(points[:, :2])
        open_ray &= is_free(scenery.occupancy, points[:, :2])
        met = open_ray & (height_m <= 0) & np.isfinite(above_m)
        depth_m[met] = t - STEP_M * (-height_m[met] / (above_m[met] - height_m[met]))
        open_ray &= height_m > 0
        above_m = height_m
    return depth_m.reshape(camera.height_px, camera.width_px)


def is_free(occupancy: OccupancyMap, xy_m: Float64Array) -> BoolArray:
    """Whether points lie in free cells, shape (N,)."""
    frame, (rows, columns) = occupancy.frame, occupancy.occupied.shape
    j = np.floor((xy_m[:, 0] - frame.origin_x_m) / frame.resolution_m).astype(np.int64)
    i = np.floor((xy_m[:, 1] - frame.origin_y_m) / frame.resolution_m).astype(np.int64)
    inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
    free: BoolArray = inside & ~occupancy.occupied[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]
    return free


if __name__ == "__main__":
    tyro.cli(main)
