"""Levels of detail against the exact images: PSNR over random views, and images per second of both, alternating.

    python -m readygo.benchmarks.rasterizer.lod out/showroom [--avatar-folder DIR] [--motion WALK] [--views 200]

Standpoints and people are those of `readygo bench render --placement any`. Times are CPU times of this thread.
"""

import json as json_module
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from readygo.benchmarks.rasterizer.runs import make_cpu
from readygo.benchmarks.rasterizer.setting import Measurement, Placement, Setting, open_setting
from readygo.common.arrays import UInt8Array
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.warm import warm

IMAGES_PER_RUN = 4


def main(
    scene: str,
    /,
    *,
    avatars: int = 2,
    placement: Placement = "any",
    avatar_folder: Path | None = None,
    motion: Path | None = None,
    views: int = 200,
    timed_views: int = 20,
    runs: int = 4,
    height_px: int = 144,
    width_px: int = 256,
    seed: int = 0,
    json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        avatars: People in every image, 2 m and more ahead of the camera.
        placement: Where people stand: on free ground in sight of the camera, or anywhere, even inside of objects.
        avatar_folder: Folder of avatars; the embedded ones by default.
        motion: How people walk: .npz with root_m and pose_axis_angle; the built-in gait by default.
        views: Views that are compared.
        timed_views: How many of them are timed.
        runs: Runs per timed view, of which the fastest counts.
        height_px: Image height.
        width_px: Image width.
        seed: Seed of the views.
        json: Print one JSON object.
    """
    warm()
    job = Measurement(
        scene=scene,
        synthetic="",
        avatars=avatars,
        placement=placement,
        avatar_folder=avatar_folder,
        avatar_gaussians=None,
        motion=motion,
        height_px=height_px,
        width_px=width_px,
        frames=1,
        views=views,
        threads=1,
        backend="cpu",
        lod="off",
        seed=seed,
    )
    setting = open_setting(job)
    exact, lod = make_cpu(setting, lod=False), make_cpu(setting, lod=True)
    result = {"scene": setting.scenery.name, "avatars": avatars, "views": views, "image_px": [height_px, width_px]}
    result |= _likeness(setting, exact, lod) | _speed(setting, [exact, lod], timed_views, runs)
    text = (
        json_module.dumps(result) if json else "\n".join(f"{key:28s} {_text(value)}" for key, value in result.items())
    )
    sys.stdout.write(text + "\n")


def _likeness(setting: Setting, exact: CpuRasterizer, lod: CpuRasterizer) -> dict[str, Any]:
    psnr_db = []
    for place in setting.places:
        view = setting.view(place, 0)
        psnr_db.append(_psnr_db(exact.render([view]).rgb[0], lod.render([view]).rgb[0]))
    lowest, p5, median = np.percentile(psnr_db, (0, 5, 50))
    return {"psnr_lowest_db": float(lowest), "psnr_p5_db": float(p5), "psnr_median_db": float(median)}


def _psnr_db(a: UInt8Array, b: UInt8Array) -> float:
    error = ((a.astype(np.float64) - b) ** 2).mean()
    return 10 * math.log10(255**2 / max(float(error), 1e-6))


def _speed(setting: Setting, rasterizers: Sequence[CpuRasterizer], views: int, runs: int) -> dict[str, Any]:
    places = setting.places[:views]
    spent_s = np.full((len(rasterizers), len(places)), np.inf)
    for _ in range(runs):
        for number, place in enumerate(places):
            images = [setting.view(place, image) for image in range(IMAGES_PER_RUN)]
            for which, rasterizer in enumerate(rasterizers):
                rasterizer.render(images[:1])
                begin_s = time.thread_time()
                rasterizer.render(images[1:])
                per_image_s = (time.thread_time() - begin_s) / (IMAGES_PER_RUN - 1)
                spent_s[which, number] = min(spent_s[which, number], per_image_s)
    exact_s, lod_s = spent_s.mean(axis=1)
    return {
        "exact_images_per_s": float(1 / exact_s),
        "lod_images_per_s": float(1 / lod_s),
        "lod_slowest_view_images_per_s": float(1 / spent_s[1].max()),
        "speed_ratio": float(exact_s / lod_s),
    }


def _text(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    tyro.cli(main)
