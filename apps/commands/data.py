"""`readygo validate` and `readygo inspect`: what a dataset holds, and whether it holds together."""

import json as json_module
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from readygo.common.dataset import Dataset, Report
from readygo.common.dataset import validate as validate_folder
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.robot.kinematics import RATE_HZ

DEFECTS_SHOWN = 20


def validate(data: Path, /, *, json: bool = False) -> None:
    """Read a dataset again, byte by byte, and report every defect.

    Args:
        data: Data folder.
        json: Print the result as JSON.

    Raises:
        DatasetError: If there is a defect.
    """
    report = _validate_with_progress(data, quiet=json)
    if json:
        _print_json(_report_as_mapping(report))
    else:
        console = Console(soft_wrap=True, highlight=False)
        for defect in report.defects[:DEFECTS_SHOWN]:
            console.print(str(defect), markup=False)
        for note in report.notes:
            console.print(f"note: {note}", markup=False)
        if report.ok:
            console.print(f"{data} is sound: {_counts(report)}.", markup=False)
    if not report.ok:
        more = len(report.defects) - DEFECTS_SHOWN
        shown = f" ({more} more not shown)" if more > 0 and not json else ""
        raise DatasetError(
            f"{data} has {len(report.defects)} defects{shown} in {_counts(report)}; remove the shards that are named "
            "and record again."
        )


def inspect(data: Path, /, *, overlay: Path | None = None, json: bool = False) -> None:
    """Say what a dataset holds, or show how its labels lie on its people.

    Args:
        data: Data folder.
        overlay: PNG to write: images with people, their joints, boxes and ground points drawn over them.
        json: Print the result as JSON.

    Raises:
        DatasetError: If there is no readable dataset, or no labels for an overlay.
    """
    if overlay is not None:
        if overlay.suffix.lower() != ".png":
            raise ConfigError(f"--overlay {overlay} must end in .png.")
        from readygo.apps.pictures.label_overlay import label_overlay
        from readygo.common.drawing.files import write_png

        write_png(overlay, label_overlay(Dataset([data])))
    summary = _summary(data)
    if json:
        _print_json(summary)
        return
    table = Table(show_header=False, box=None)
    for name, value in summary.items():
        table.add_row(name, _text(value))
    Console(highlight=False).print(table)


def _validate_with_progress(data: Path, *, quiet: bool) -> Report:
    columns = (TextColumn("reading"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=quiet) as progress:
        task = progress.add_task("reading", total=None)
        return validate_folder(data, progress=lambda done, total: progress.update(task, completed=done, total=total))


def _counts(report: Report) -> str:
    return f"{report.episode_count} episodes, {report.sample_count} samples, {report.shard_count} shards"


def _report_as_mapping(report: Report) -> dict[str, Any]:
    return {
        "ok": report.ok,
        "shards": report.shard_count,
        "episodes": report.episode_count,
        "samples": report.sample_count,
        "size_bytes": report.size_bytes,
        "defects": [{"shard": d.shard, "kind": d.kind, "text": d.text} for d in report.defects],
        "notes": list(report.notes),
    }


def _summary(data: Path) -> dict[str, Any]:
    dataset = Dataset([data])
    truth = dataset.truth
    with_human = truth["human_distance_m"][truth["human_distance_m"] < float("inf")]
    samples_per_shard = Counter(entry.shard for entry in dataset.episodes for _ in range(entry.sample_count))
    recorded = dataset.provenance.to_mapping()
    config = recorded.pop("config", {})
    return {
        "folder": str(data),
        "episodes": len(dataset.episodes),
        "splits": sorted({entry.episode.split.value for entry in dataset.episodes}),
        "samples": len(dataset),
        "hours": round(len(dataset) / RATE_HZ / 3600, 4),
        "shards": len(dataset.shards),
        "samples_per_shard_min": min(samples_per_shard.values()),
        "samples_per_shard_max": max(samples_per_shard.values()),
        "size_bytes": sum(shard.stat().st_size for shard in dataset.shards),
        "image_height_px": dataset.height_px,
        "image_width_px": dataset.width_px,
        "outputs": list(dataset.outputs),
        "labels": list(dataset.labels),
        "speed_mean_mps": round(float(dataset.actions[:, 0].mean()), 3),
        "human_visible_fraction": round(float(truth["human_visible"].mean()), 3),
        "human_distance_min_m": round(float(with_human.min()), 3) if len(with_human) else None,
        "replans": int(truth["replanned"].sum()),
        "content_hash": dataset.content_hash,
        **dict(sorted(recorded.items())),
        "config": {name: config.get(name) for name in ("robot", "episode")},
    }


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return "\n".join(f"{key} = {_text(item)}" for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_text, value))
    return str(value)


def _print_json(mapping: Mapping[str, Any]) -> None:
    sys.stdout.write(json_module.dumps(mapping, indent=2) + "\n")
