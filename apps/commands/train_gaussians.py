"""`readygo scene train`: trains Gaussians on posed images."""

import json as json_module
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from rich.table import Table

from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError, RunError
from readygo.common.extras import install_command
from readygo.services.reconstructor.training import config as configs
from readygo.services.reconstructor.training.config import Device, GaussiansConfig, Preset, weak_texture


def scene_train(
    posed: Path,
    /,
    *,
    out: Path,
    preset: Preset = "draft",
    steps: int | None = None,
    batch: int | None = None,
    gaussians: int | None = None,
    side_px: int | None = None,
    hold_out: int | None = None,
    method: Literal["gradients", "mcmc"] | None = None,
    plain: bool = False,
    neighbour_distance_m: float | None = None,
    bare_walls: bool = False,
    device: Device = "cpu",
    seed: int = 0,
    json: bool = False,
) -> None:
    """Train Gaussians on posed images; writes OUT/gaussians.ply and the quality on held-out images.

    After an interruption the same command resumes, with the same result. OUT/previews shows held-out photos, the
    rendered Gaussians from the same poses, and the difference.

    Args:
        posed: Folder with images/ and a COLMAP model in sparse/0, as `readygo scene poses` writes to OUT/posed.
        out: Folder of the training, new or to resume.
        preset: draft takes minutes on two cores; standard and high take longer.
        steps: Optimiser steps.
        batch: Views per step, rendered in parallel on as many cores.
        gaussians: Largest number of Gaussians.
        side_px: Longer side of the training images [px]: larger ones are scaled down.
        hold_out: Every n-th image is held out: it measures the quality and is not trained on; 0: none.
        method: gradients adds Gaussians where image gradients are large; mcmc moves Gaussians within a fixed budget.
        plain: Train without the surface losses (PGSR): faster, better images, worse depths and maps.
        neighbour_distance_m: Largest distance between views that the surface losses compare [m]; not with plain.
        bare_walls: Settings for rooms with little texture.
        device: cuda trains with gsplat's kernels on a GPU; experimental, no GPU has run it yet.
        seed: Seed of everything random.
        json: Print the report as JSON.
    """
    config = _config(
        preset,
        steps=steps,
        batch=batch,
        side_max_px=side_px,
        hold_out=hold_out,
        device=device,
        density={"count_max": gaussians, "method": method},
        geometry={"enabled": False if plain else None, "distance_max_m": neighbour_distance_m},
    )
    config = replace(weak_texture(config) if bare_walls else config, seed=seed)
    notes = PlainConsole(stderr=True)
    report = _train(posed, out, config, notes)
    if json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    table = Table(title=f"Gaussians of {posed}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    PlainConsole().print(table)


def _config(name: Preset, **changes: Any) -> GaussiansConfig:
    """A preset, overridden by the options that were given."""
    config = configs.preset(name)
    try:
        for key in ("density", "geometry"):
            part = {field: value for field, value in changes.pop(key).items() if value is not None}
            config = replace(config, **{key: replace(getattr(config, key), **part)})
        return replace(config, **{field: value for field, value in changes.items() if value is not None})
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _train(posed: Path, out: Path, config: GaussiansConfig, notes: PlainConsole) -> dict[str, Any]:
    try:
        from readygo.services.reconstructor.training.train import TrainingProgress, train_gaussians
    except ImportError as error:
        raise ConfigError(f"Gaussians need torch; run: {install_command('reconstruct')}") from error

    with notes.status("reading images ...") as line:

        def tell(at: TrainingProgress) -> None:
            psnr = "" if at.psnr_db is None else f", held out {at.psnr_db:.2f} dB"
            count = f"{at.gaussians:,} Gaussians"
            line.update(f"step {at.step} of {at.steps}, {count}, loss {at.loss:.4f}{psnr}, {at.seconds:.0f} s")

        try:
            return train_gaussians(posed, out, config, tell)
        except KeyboardInterrupt:
            raise RunError(f"Interrupted; the same command resumes from the state in {out}.") from None


def _rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    total_s = sum(report["seconds"].values())
    rows = [("Gaussians", f"{report['gaussians']:,} of {report['images']} images")]
    if report["psnr_db"] is not None:
        rows.append(("held out", f"{report['psnr_db']:.2f} dB, SSIM {report['ssim']:.3f}"))
        rows += [(row["image"], f"{row['psnr_db']:.2f} dB, SSIM {row['ssim']:.3f}") for row in report["held_out"]]
    rows += [(name, f"{spent_s:.1f} s") for name, spent_s in report["seconds"].items()]
    rows.append(("in all", f"{total_s:.1f} s"))
    if report["gpu_bytes"]:
        rows.append(("memory of the GPU", f"{report['gpu_bytes'] / 1e9:.1f} GB"))
    return rows
