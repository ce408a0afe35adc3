"""An export as a job of parts: each is written whole or not at all, side by side, and none twice."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import readygo
from readygo.apps.export.formats import FORMATS, Format
from readygo.apps.export.source import Part, Source
from readygo.common.documents import read_json
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.files import write_whole

STATE_FOLDER = ".readygo-export"
WAITING_MAX = 2
"""Parts that wait for each process: many parts cost no memory."""

Progress = Callable[[int, int], None]
"""Hears the episodes that are done, and all."""
Facts = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ExportJob:
    """What is exported to where."""

    data: tuple[Path, ...]
    to: str
    out: Path
    rate_hz: int | None = None
    """Rows per second; the format's own rate by default."""

    @property
    def format(self) -> Format:
        """The format."""
        return FORMATS[self.to]

    def source(self) -> Source:
        """What it reads."""
        return Source(self.data, self.rate_hz or self.format.rate_hz)


def export(job: ExportJob, *, workers: int = 1, progress: Progress = lambda done, total: None) -> dict[str, Any]:
    """Do a job, or what is left of it.

    Args:
        job: What to do.
        workers: Processes that write parts side by side; 1 is this process.
        progress: Hears how far it is.

    Returns:
        What was written, as plain values.

    Raises:
        DatasetError: If the data or the folder cannot be used.
        ConfigError: If the rate does not fit.
        ReadygoError: If something cannot be written, or a package is missing.
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
    for part, facts in _written(job, source, left, workers):
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
    """The folder in which a job notes what is done."""

    def __init__(self, out: Path) -> None:
        self._out, self._folder = out, out / STATE_FOLDER

    def begin(self, identity: Facts) -> None:
        """Take the folder for a job, or find that it is this job's."""
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

    def has(self, part: Part) -> bool:
        return self._file(part).exists()

    def keep(self, part: Part, facts: Facts) -> None:
        write_whole(self._file(part), json.dumps(facts), raises=DatasetError)

    def facts(self, part: Part) -> Any:
        return read_json(self._file(part))

    def _file(self, part: Part) -> Path:
        return self._folder / f"part-{part.number:05d}.json"


def _identity(job: ExportJob, source: Source) -> dict[str, Any]:
    return {
        "format": job.to,
        "data": source.dataset.content_hash,
        "rate_hz": source.rate_hz,
        "readygo_version": readygo.__version__,
    }


def _written(job: ExportJob, source: Source, parts: Sequence[Part], workers: int) -> Iterator[tuple[Part, Facts]]:
    """Write parts, and say what they hold as they are done."""
    if workers == 1 or len(parts) < 2:
        for part in parts:
            yield part, job.format.write(source, part, job.out)
        return
    waiting: dict[Future[Facts], Part] = {}
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


_opened: list[tuple[ExportJob, Source]] = []
"""What a process of the pool writes from."""


def _open(job: ExportJob) -> None:
    _opened.append((job, job.source()))


def _write(part: Part) -> Facts:
    ((job, source),) = _opened
    return job.format.write(source, part, job.out)
