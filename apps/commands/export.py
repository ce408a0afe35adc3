"""`readygo export`: a dataset in the format of another program."""

from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.export.job import ExportJob
from readygo.apps.export.job import export as export_job
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError

FormatName = Literal["lerobot", "gnm", "rlds", "huggingface-parquet", "webdataset", "npz"]


def export(
    data: tuple[Path, ...],
    /,
    *,
    to: FormatName,
    out: Path,
    rate_hz: int | None = None,
    workers: int = 1,
) -> None:
    """Write a dataset in the format of another program; docs/export.md says what is in each.

    Stopped, the same command goes on where it was. Shards that are still being written are left out.

    Args:
        data: Data folders.
        to: lerobot (v3.0), gnm (GNM, ViNT, NoMaD), rlds (TFRecord), huggingface-parquet, webdataset (tar) or npz.
        out: Folder to write, new or of the same export.
        rate_hz: Rows per second, a divisor of the data's; gnm has 4 by default, the others a row for every image.
        workers: Processes that write side by side.

    Raises:
        ConfigError: If there is no data folder, a package is missing, or the rate does not fit the images.
        DatasetError: If the data cannot be read, or the folder is of something else.
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
