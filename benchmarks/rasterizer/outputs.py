"""Extra time of the CPU rasterizer for depth, mask and normals over colours alone, on one core.

    python -m readygo.benchmarks.rasterizer.outputs scenes/lobby --avatars AVATARS

Two people walk in full sight before random standpoints of the scene's free area. All sets of images of a view are
drawn in turn, several times; the fastest of each counts. Times are CPU times of this thread.
"""

import json
import math
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from readygo.benchmarks.rasterizer.setting import Measurement, open_setting
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import pack_cloud

SETS = (
    ("rgb",),
    ("rgb", "depth"),
    ("rgb", "median_depth"),
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
    job = Measurement(
        scene=str(scene), avatar_folder=avatars, height_px=height_px, width_px=width_px, views=views, seed=seed
    )
    setting = open_setting(job)
    layers = [pack_cloud(setting.scenery.cloud(), normals=True)]
    rasterizer = CpuRasterizer(layers, setting.wardrobe, setting.camera.K_px, height_px, width_px)
    image_ms = np.mean([_fastest_ms(rasterizer, runs, setting.view(place, 0)) for place in setting.places], axis=0)
    rows = [
        {"outputs": ",".join(names), "image_ms": float(ms), "extra_percent": float(100 * (ms / image_ms[0] - 1))}
        for names, ms in zip(SETS, image_ms, strict=True)
    ]
    line = "{image_ms:6.2f} ms  {extra_percent:+5.1f} %  {outputs}"
    print(json.dumps(rows) if json_output else "\n".join(line.format(**row) for row in rows))


def _fastest_ms(rasterizer: CpuRasterizer, runs: int, view: View) -> list[float]:
    """Fastest time of each set of images [ms]."""
    best = [math.inf] * len(SETS)
    for _ in range(runs + 1):
        for k, names in enumerate(SETS):
            start_s = time.thread_time()
            rasterizer.render([view], names)
            best[k] = min(best[k], 1e3 * (time.thread_time() - start_s))
    return best


if __name__ == "__main__":
    tyro.cli(main)
