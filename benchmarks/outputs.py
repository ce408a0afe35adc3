"""Extra time of the CPU rasterizer for depth, mask and normals over colours alone, on one core.

    python benchmarks/outputs.py scenes/lobby --avatars AVATARS

Two people stand 2 m and 3 m ahead of random poses in the free area of the scene's robot map. All sets of images of a
view are drawn in turn, several times; the fastest of each counts. Times are CPU times of this thread.
"""

import json
import math
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common.avatars import load_avatars
from common.maps import largest_free_area
from common.rasterizer.cpu import CpuRasterizer, PosedPerson
from common.rasterizer.packed import pack_cloud
from common.robot import CameraConfig
from common.scenes import Scene, load_scene

SETS = (
    ("rgb",),
    ("rgb", "depth", "mask"),
    ("rgb", "depth", "median_depth", "alpha", "mask"),
    ("rgb", "depth", "median_depth", "alpha", "mask", "normal"),
)


def main(
    scene: Path,
    /,
    *,
    avatars: Path | None = None,
    views: int = 12,
    runs: int = 12,
    height_px: int = 144,
    width_px: int = 256,
    seed: int = 0,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle.
        avatars: Folder of avatars; the embedded ones by default.
        views: Camera poses.
        runs: Runs per view and set of images, of which the fastest counts.
        height_px: Image height.
        width_px: Image width.
        seed: Seed of the camera poses.
        json_output: Print JSON.
    """
    loaded, wearers = load_scene(scene), list(load_avatars(avatars).values())
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    clouds = [loaded.cloud] if loaded.sky is None else [loaded.cloud, loaded.sky]
    layers = [pack_cloud(cloud, normals=True) for cloud in clouds]
    rasterizer = CpuRasterizer(layers, wearers, camera.K_px, height_px, width_px)
    rng = np.random.default_rng(seed)
    places = [_place(loaded, camera, len(wearers), rng) for _ in range(views)]
    image_ms = np.mean([_fastest_ms(rasterizer, runs, *place) for place in places], axis=0)
    rows = [
        {"outputs": ",".join(names), "image_ms": float(ms), "extra_percent": float(100 * (ms / image_ms[0] - 1))}
        for names, ms in zip(SETS, image_ms, strict=True)
    ]
    line = "{image_ms:6.2f} ms  {extra_percent:+5.1f} %  {outputs}"
    print(json.dumps(rows) if json_output else "\n".join(line.format(**row) for row in rows))


def _place(scene: Scene, camera: CameraConfig, avatars: int, rng: np.random.Generator) -> tuple[Any, list[PosedPerson]]:
    """A camera pose and the people ahead."""
    occupancy = scene.maps.robot
    cells = np.argwhere(largest_free_area(occupancy, 0.3)[0])
    x_m, y_m = occupancy.frame.centre_m(*(int(i) for i in cells[rng.integers(len(cells))]))
    yaw_rad = float(rng.uniform(-math.pi, math.pi))
    floor_m = scene.maps.floor.at(x_m, y_m)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    people = [
        PosedPerson(
            avatar=k % avatars,
            root_m=np.array([x_m + c * ahead - s * left, y_m + s * ahead + c * left, floor_m + 0.95]),
            pose_axis_angle=np.zeros((24, 3)),
        )
        for k, (ahead, left) in enumerate(((2.0, 0.5), (3.0, -0.7)))
    ]
    return camera.T_world_camera(x_m, y_m, yaw_rad, floor_m), people


def _fastest_ms(rasterizer: CpuRasterizer, runs: int, T_world_camera: Any, people: list[PosedPerson]) -> list[float]:
    """Per set of images."""
    best = [math.inf] * len(SETS)
    for _ in range(runs + 1):
        for k, names in enumerate(SETS):
            start_s = time.thread_time()
            rasterizer.render_images(T_world_camera, people, names)
            best[k] = min(best[k], 1e3 * (time.thread_time() - start_s))
    return best


if __name__ == "__main__":
    tyro.cli(main)
