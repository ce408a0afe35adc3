"""`readygo validate` and `readygo inspect`: check a dataset, and summarise its content."""

import dataclasses
import json as json_module
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, DownloadColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.report.card import dataset_summary, summary_lines
from readygo.apps.terminal import PlainConsole
from readygo.common.dataset import Dataset, Report, recorded_clarity
from readygo.common.dataset import validate as validate_folder
from readygo.common.drawing.files import write_png
from readygo.common.errors import ConfigError, DatasetError
from readygo.runs.completeness import MISSING, check_completeness

DEFECTS_SHOWN = 20


@dataclass(frozen=True, kw_only=True)
class ValidateOptions:
    """Read every byte of a dataset, and report every defect.

    If the run's ledger is there, the folder is also compared with what was recorded: a missing shard is a defect.
    """

    data: Positional[Path]
    """Data folder."""
    json: bool = False
    """Print the result as JSON."""


def validate(options: ValidateOptions) -> None:
    """Read every byte of a dataset, and report every defect."""
    report = _with_completeness(_validate_with_progress(options.data, quiet=options.json))
    clarity = recorded_clarity(Dataset([options.data])) if report.ok else None
    if options.json:
        _print_json(_report_as_mapping(report) | {"clarity": clarity and clarity.to_mapping()})
    else:
        console = PlainConsole(soft_wrap=True)
        for defect in report.defects[:DEFECTS_SHOWN]:
            console.print(str(defect), markup=False)
        for note in report.notes:
            console.print(f"note: {note}", markup=False)
        if clarity is not None:
            console.print(f"{'warning' if clarity.blurred else 'note'}: {clarity}.", markup=False)
            console.print(f"{options.data} is sound: {_counts(report)}.", markup=False)
    if not report.ok:
        more = len(report.defects) - DEFECTS_SHOWN
        shown = f" ({more} more not shown)" if more > 0 and not options.json else ""
        raise DatasetError(
            f"{options.data} has {len(report.defects)} defects{shown} in {_counts(report)}; {_remedy(report)}"
        )


@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """Summarise a dataset, and draw sample images, or its labels over its images."""

    data: Positional[Path]
    """Data folder."""
    sheet: Path | None = None
    """PNG to write: recorded images, spread over the episodes, with place and sharpness."""
    overlay: Path | None = None
    """PNG to write: images with pedestrians, overlaid with their joints, boxes and ground points."""
    json: bool = False
    """Print the complete summary as JSON."""


def inspect(options: InspectOptions) -> None:
    """Summarise a dataset, and draw sample images, or its labels over its images."""
    for option, path in (("--sheet", options.sheet), ("--overlay", options.overlay)):
        if path is not None and path.suffix.lower() != ".png":
            raise ConfigError(f"{option} {path} must end in .png.")
    dataset = Dataset([options.data])
    if options.overlay is not None:
        from readygo.apps.pictures.label_overlay import label_overlay

        write_png(options.overlay, label_overlay(dataset))
    if options.sheet is not None:
        from readygo.apps.views.recorded import thumbnails

        write_png(options.sheet, thumbnails(dataset, options.data.resolve().name))
    summary = dataset_summary(dataset, options.data)
    if options.json:
        _print_json(summary)
        return
    table = Table(show_header=False, box=None)
    for name, text in summary_lines(summary).items():
        table.add_row(name, Text(text))
    PlainConsole().print(table)


def _validate_with_progress(data: Path, *, quiet: bool) -> Report:
    columns = (TextColumn("reading"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with SteadyProgress(*columns, quiet=quiet, transient=True) as progress:
        task = progress.add_task("reading", total=None)
        return validate_folder(data, progress=lambda done, total: progress.update(task, completed=done, total=total))


def _with_completeness(report: Report) -> Report:
    """The report, extended by episodes and shards that the run recorded and the folder lacks."""
    defects, notes = check_completeness(report.folder)
    return dataclasses.replace(report, defects=(*report.defects, *defects), notes=(*report.notes, *notes))


def _remedy(report: Report) -> str:
    if all(defect.kind == MISSING for defect in report.defects):
        return f"run the same `readygo generate` again, or `readygo recover {report.folder}`, to record them again."
    return "remove the shards that are named and record again."


def _counts(report: Report) -> str:
    return f"{report.episode_count:,} episodes, {report.sample_count:,} samples, {report.shard_count} shards"


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


def _print_json(mapping: Mapping[str, Any]) -> None:
    sys.stdout.write(json_module.dumps(mapping, indent=2) + "\n")
