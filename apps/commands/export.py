"""`readygo export`: a dataset in the format of another framework."""

from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.export.job import ExportJob
from readygo.apps.export.job import export as export_job
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError

FormatName = Literal["lerobot", "gnm", "huggingface-parquet", "webdataset"]


def export(
    data: tuple[Path, ...],
    /,
    *,
    to: FormatName,
    out: Path,
    rate_hz: int | None = None,
    workers: int = 1,
) -> None:
    """Export a dataset to the format of another framework; docs/export.md describes each format.

    After an interruption the same command resumes. Shards that are still being written are skipped.

    Args:
        data: Data folders.
        to: Format: lerobot (v3.0), gnm (GNM, ViNT, NoMaD), huggingface-parquet or webdataset (tar).
        out: Folder to write: new, or of the same export.
        rate_hz: Rows per second [Hz], a divisor of the data's rate; by default 4 for gnm, else one row per image.
        workers: Processes that write in parallel.

    Raises:
        ConfigError: If there is no data folder, a package is missing, or the rate does not fit the images.
        DatasetError: If the data cannot be read, or the folder holds something else.
    """
    if not data:
        raise ConfigError("Name a data folder: readygo export DATA --to FORMAT --out FOLDER.")
    job = ExportJob(data=data, to=to, out=out, rate_hz=rate_hz)
    columns = (TextColumn("exporting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with SteadyProgress(*columns, transient=True) as progress:
        task = progress.add_task("exporting", total=None)
        said = export_job(
            job, workers=workers, progress=lambda done, total: progress.update(task, completed=done, total=total)
        )
    words = f"{said['episodes']} episodes, {said['rows']:,} rows at {said['rate_hz']} Hz in {said['out']} ({to})"
    went_on = f"; {said['resumed_files']} parts were there already" if said["resumed_files"] else ""
    PlainConsole(soft_wrap=True).print(f"{words}{went_on}", markup=False)
