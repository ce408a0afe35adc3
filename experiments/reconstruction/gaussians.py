"""Speed and quality of a training of Gaussians on posed images.

    python -m experiments.reconstruction.gaussians POSED --out out/banana --json

A step is one of the optimiser, with `batch` views. Its cost is given at whole images, from the last fifth of the
training, in processor time of all threads (which neighbours on the machine change little) and by the wall clock. Two
cores that have nothing else to do take at least half of the processor time.
"""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from readygo.benchmarks.rasterizer.render import machine
from readygo.services.reconstructor.training.config import GaussiansConfig, preset
from readygo.services.reconstructor.training.progress import TrainingProgress
from readygo.services.reconstructor.training.train import train_gaussians

LAST = 0.8
"""Steps after this share of the training are measured."""


def main(
    posed: Path,
    /,
    *,
    out: Path,
    steps: int = 1000,
    gaussians: int = 20_000,
    batch: int = 2,
    side_px: int = 480,
    hold_out: int = 14,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Train and measure.

    Args:
        posed: Folder with images/ and sparse/0.
        out: Folder of the training, which must be new: a resumed training would not be measured whole.
        steps: Steps of the optimiser.
        gaussians: At most so many.
        batch: Views a step.
        side_px: Longer side of the images.
        hold_out: Every so-manieth image is held out.
        json_output: Print JSON.
    """
    config = settings(steps=steps, gaussians=gaussians, batch=batch, side_px=side_px, hold_out=hold_out)
    result = measured(posed, out, config)
    print(json.dumps(result) if json_output else "\n".join(f"{name} {value}" for name, value in result.items()))


def settings(*, steps: int, gaussians: int, batch: int, side_px: int, hold_out: int) -> GaussiansConfig:
    """The preset `draft` for small photos, without what makes surfaces: others that it is compared with have none."""
    draft = preset("draft")
    return replace(
        draft,
        steps=steps,
        batch=batch,
        side_max_px=side_px,
        hold_out=hold_out,
        density=replace(draft.density, count_max=gaussians),
        geometry=replace(draft.geometry, enabled=False),
    )


def measured(posed: Path, out: Path, config: GaussiansConfig) -> dict[str, Any]:
    """Train; what it cost and what came of it."""
    clocks: list[tuple[int, float, float]] = []

    def hear(at: TrainingProgress) -> None:
        clocks.append((at.step, time.process_time(), time.monotonic()))

    begin = time.process_time(), time.monotonic()
    report = train_gaussians(posed, out, config, hear)
    end = time.process_time(), time.monotonic()
    late = [clock for clock in clocks if clock[0] >= LAST * config.steps]
    count = max(late[-1][0] - late[0][0], 1)
    cpu_s, wall_s = ((late[-1][k] - late[0][k]) / count for k in (1, 2))
    return {
        "machine": machine(),
        "steps": config.steps,
        "views_a_step": config.batch,
        "gaussians": report["gaussians"],
        "psnr_db": report["psnr_db"],
        "ssim": report["ssim"],
        "held_out": [row["image"] for row in report["held_out"]],
        "cpu_s": end[0] - begin[0],
        "wall_s": end[1] - begin[1],
        "late_step_cpu_s": cpu_s,
        "late_step_wall_s": wall_s,
        "late_views_per_cpu_s": config.batch / cpu_s if cpu_s else None,
        "seconds": report["seconds"],
    }


if __name__ == "__main__":
    tyro.cli(main)
