"""`readygo scene train`: trains Gaussians on posed images."""

import json as json_module
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from tyro.conf import Fixed, Positional

from readygo.apps.cli import NOTHING_SAVED
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError
from readygo.common.extras import install_command
from readygo.runs.sections import Keys, Sections, with_file, with_keys
from readygo.services.reconstructor import GaussiansConfig, Preset, preset, weak_texture


@dataclass(frozen=True, kw_only=True)
class SceneTrainOptions:
    """Train Gaussians on posed images; writes OUT/gaussians.ply and the quality on held-out images.

    After an interruption the same command resumes, with the same result. OUT/previews shows held-out photos, the
    rendered Gaussians from the same poses, and the difference.
    """

    posed: Positional[Path]
    """Folder with images/ and a COLMAP model in sparse/0, as `readygo scene poses` writes to OUT/posed."""
    out: Path
    """Folder of the training, new or to resume."""
    preset: Preset = "draft"
    """draft takes minutes on two cores; standard and high take longer."""
    bare_walls: bool = False
    """Settings for rooms with little texture."""
    json: bool = False
    """Print the report as JSON."""
    config: Path | None = None
    """TOML file with settings; `--KEY VALUE` and `--SECTION.KEY VALUE` override it."""
    keys: Annotated[Keys, Sections(GaussiansConfig), Fixed] = field(default_factory=dict)


def scene_train(options: SceneTrainOptions) -> None:
    """Train Gaussians on posed images; writes OUT/gaussians.ply and the quality on held-out images."""
    config = weak_texture(preset(options.preset)) if options.bare_walls else preset(options.preset)
    config = with_keys(with_file(config, options.config), options.keys)
    notes = PlainConsole(stderr=True)
    report = _train(options.posed, options.out, config, notes)
    if options.json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    table = Table(title=f"Gaussians of {options.posed}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    PlainConsole().print(table)


def _train(posed: Path, out: Path, config: GaussiansConfig, notes: PlainConsole) -> dict[str, Any]:
    try:
        from readygo.services.reconstructor import TrainingProgress, train_gaussians
    except ImportError as error:
        raise ConfigError(f"Gaussians need torch; run: {install_command('reconstruct')}") from error

    with notes.status("reading images ...") as line:

        def tell(at: TrainingProgress) -> None:
            if at.searches:
                line.update(f"searching for what moved, step {at.step} of {at.steps}")
                return
            psnr = "" if at.psnr_db is None else f", held out {at.psnr_db:.2f} dB"
            count = f"{at.gaussians:,} Gaussians"
            line.update(f"step {at.step} of {at.steps}, {count}, loss {at.loss:.4f}{psnr}, {at.seconds:.0f} s")

        try:
            return train_gaussians(posed, out, config, tell)
        except KeyboardInterrupt:
            # The training removes its folder if nothing in it is finished.
            state = f"the same command resumes from the state in {out}."
            raise KeyboardInterrupt(state if out.exists() else NOTHING_SAVED) from None


def _rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    total_s = sum(report["seconds"].values())
    rows = [("Gaussians", f"{report['gaussians']:,} of {report['images']} images")]
    if report["psnr_db"] is not None:
        rows.append(("held out", _quality(report)))
        rows += [(row["image"], _quality(row)) for row in report["held_out"]]
    rows += [("note", note) for note in report["notes"]]
    rows += [(name, f"{spent_s:.1f} s") for name, spent_s in report["seconds"].items()]
    rows.append(("in all", f"{total_s:.1f} s"))
    if report["gpu_bytes"]:
        rows.append(("memory of the GPU", f"{report['gpu_bytes'] / 1e9:.1f} GB"))
    return rows


def _quality(row: dict[str, Any]) -> str:
    fitted = f"{row['psnr_fitted_db']:.2f} dB with fitted colours"
    return f"{row['psnr_db']:.2f} dB ({fitted}), SSIM {row['ssim']:.3f}"
