"""An export as a job of parts: each part is written atomically and once, several in parallel."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import readygo
from readygo.apps.export.formats import FORMATS, Format
from readygo.apps.export.source import ExportPart, ExportSource
from readygo.common.documents import read_json
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.files import write_whole

STATE_FOLDER = ".readygo-export"
WAITING_MAX = 2
"""Largest number of waiting parts per process, which bounds memory."""

Progress = Callable[[int, int], None]
"""Called with the numbers of finished and of all episodes."""
Facts = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ExportJob:
    """Data, format and folder of an export."""

    data: tuple[Path, ...]
    to: str
    out: Path
    rate_hz: int | None = None
    """Rows per second [Hz]; the format's rate by default."""

    @property
    def format(self) -> Format:
        """The format that `to` names."""
        return FORMATS[self.to]

    def source(self) -> ExportSource:
        """The episodes to export."""
        return ExportSource(self.data, self.rate_hz or self.format.rate_hz)


def export(job: ExportJob, *, workers: int = 1, progress: Progress = lambda done, total: None) -> dict[str, Any]:
    """Run an export, or the rest of it.

    Args:
        job: The export.
        workers: Processes that write parts in parallel; 1 is this process.
        progress: Called with the numbers of finished and of all episodes.

    Returns:
        Summary of the written files, as plain values.

    Raises:
        DatasetError: If the data or the folder cannot be used.
        ConfigError: If the rate does not fit the images.
        ReadygoError: If a file cannot be written, or a package is missing.
    """
    job.format.check()
    if workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {workers}.")
    source = job.source()
    parts = source.parts(job.format.part_bytes)
    state = _State(job.out)
    state.begin(_identity(job, source))
    left = [part for part in parts if not state.has(part)]
    done = source.episode_count - sum(len(part.episodes) for part in left)
    progress(done, source.episode_count)
    for part, facts in _write_parts(job, source, left, workers):
        state.keep(part, facts)
        done += len(part.episodes)
        progress(done, source.episode_count)
    job.format.finish(source, job.out, [state.facts(part) for part in parts])
    return {
        "to": job.to,
        "out": str(job.out),
        "episodes": source.episode_count,
        "rows": source.row_count,
        "rate_hz": source.rate_hz,
        "files": len(parts),
        "resumed_files": len(parts) - len(left),
    }


class _State:
    """The folder with the state of a job: its identity and its finished parts."""

    def __init__(self, out: Path) -> None:
        self._out, self._folder = out, out / STATE_FOLDER

    def begin(self, identity: Facts) -> None:
        """Claim the folder for a job, or check that it belongs to this job."""
        file = self._folder / "job.json"
        if file.exists():
            theirs = read_json(file)
            if different := [name for name in identity if theirs.get(name) != identity[name]]:
                raise DatasetError(
                    f"{self._out} holds another export: {', '.join(different)} differ; choose another --out."
                )
            return
        if self._out.exists() and (not self._out.is_dir() or any(self._out.iterdir())):
            raise DatasetError(f"{self._out} holds files of something else; choose a new folder with --out.")
        write_whole(file, json.dumps(identity, indent=2), raises=DatasetError)

    def has(self, part: ExportPart) -> bool:
        return self._file(part).exists()

    def keep(self, part: ExportPart, facts: Facts) -> None:
        write_whole(self._file(part), json.dumps(facts), raises=DatasetError)

    def facts(self, part: ExportPart) -> Any:
        return read_json(self._file(part))

    def _file(self, part: ExportPart) -> Path:
        return self._folder / f"part-{part.number:05d}.json"


def _identity(job: ExportJob, source: ExportSource) -> dict[str, Any]:
    return {
        "format": job.to,
        "data": source.dataset.content_hash,
        "rate_hz": source.rate_hz,
        "readygo_version": readygo.__version__,
    }


def _write_parts(
    job: ExportJob, source: ExportSource, parts: Sequence[ExportPart], workers: int
) -> Iterator[tuple[ExportPart, Facts]]:
    """Write parts, and yield each with its facts when it is done."""
    if workers == 1 or len(parts) < 2:
        for part in parts:
            yield part, job.format.write(source, part, job.out)
        return
    waiting: dict[Future[Facts], ExportPart] = {}
    left = iter(parts)
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=_open, initargs=(job,)) as pool:
        try:
            while True:
                while len(waiting) < WAITING_MAX * workers and (following := next(left, None)) is not None:
                    waiting[pool.submit(_write, following)] = following
                if not waiting:
                    return
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


_opened: list[tuple[ExportJob, ExportSource]] = []
"""Job and source of a process of the pool."""


def _open(job: ExportJob) -> None:
    _opened.append((job, job.source()))


def _write(part: ExportPart) -> Facts:
    ((job, source),) = _opened
    return job.format.write(source, part, job.out)
