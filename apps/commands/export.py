"""`readygo export`: a dataset in the format of another framework."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.export.job import ExportJob
from readygo.apps.export.job import export as export_job
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError

FormatName = Literal["lerobot", "gnm", "huggingface-parquet", "webdataset"]


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Export a dataset to the format of another framework; docs/export.md describes each format.

    After an interruption the same command resumes. Shards that are still being written are skipped.
    """

    data: Positional[tuple[Path, ...]]
    """Data folders."""
    to: FormatName
    """Format: lerobot (v3.0), gnm (GNM, ViNT, NoMaD), huggingface-parquet or webdataset (tar)."""
    out: Path
    """Folder to write: new, or of the same export."""
    rate_hz: int | None = None
    """Rows per second [Hz], a divisor of the data's rate; by default 4 for gnm, else one row per image."""
    workers: int = 1
    """Processes that write in parallel."""


def export(options: ExportOptions) -> None:
    """Export a dataset to the format of another framework; docs/export.md describes each format."""
    if not options.data:
        raise ConfigError("Name a data folder: readygo export DATA --to FORMAT --out FOLDER.")
    job = ExportJob(data=options.data, to=options.to, out=options.out, rate_hz=options.rate_hz)
    columns = (TextColumn("exporting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with SteadyProgress(*columns, transient=True) as progress:
        task = progress.add_task("exporting", total=None)
        said = export_job(
            job,
            workers=options.workers,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
    words = (
        f"{said['episodes']} episodes, {said['rows']:,} rows at {said['rate_hz']} Hz in {said['out']} ({options.to})"
    )
    went_on = f"; {said['resumed_files']} parts were there already" if said["resumed_files"] else ""
    PlainConsole(soft_wrap=True).print(f"{words}{went_on}", markup=False)
