"""The folder of a sweep.

ARM/SCENE/SEED/             what the command of a point writes
sweep.json                  all points and their results; sweep.md and sweep.html have the table
.sweep/plans/HASH.toml      the sweep's file; jobs read this copy, so that they keep their numbers
.sweep/points/ARM/SCENE/SEED.json    record of a point; beside it its log, and a lock while it runs
.sweep/logs/                what Slurm's jobs print
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from readygo.apps.sweep.plan import Sweep, SweepPoint
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_json, write_json
from readygo.common.errors import ConfigError, RunError
from readygo.common.files import write_whole
from readygo.common.locks import held
from readygo.runs.folder import check_new

STATE_FOLDER = ".sweep"
JOINED_FILE = "sweep.json"
State = Literal["running", "done", "failed", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class PointRecord:
    """How a point ended, or that it runs."""

    name: str
    """ARM/SCENE/SEED."""
    sha256: str
    """Hash of what it runs."""
    state: State
    reason: str = ""
    """Last line of its log, if it failed."""
    attempts: int = 0
    exit_code: int = 0
    commit: str = ""
    """Commit of the sources of the last attempt; empty for an installed package."""
    host: str = ""
    wall_s: float = 0.0
    """Wall time of the last attempt [s]."""
    result: Any = None
    """What the command printed as JSON, or its scores; None unless it is done."""


@dataclass(frozen=True, kw_only=True)
class SweepFolder:
    """A sweep's folder."""

    path: Path

    @property
    def state(self) -> Path:
        """Folder of plans, records and logs."""
        return self.path / STATE_FOLDER

    @property
    def logs(self) -> Path:
        """Folder of the logs of Slurm's jobs."""
        return self.state / "logs"

    @property
    def points(self) -> Path:
        """Folder of the records and logs of the points."""
        return self.state / "points"

    def out(self, point: SweepPoint) -> Path:
        """Folder that the command of a point writes into."""
        return self.path / point.name

    def log(self, point: SweepPoint) -> Path:
        """What the command of a point printed on standard error."""
        return self._beside(point, ".log")

    def output(self, point: SweepPoint) -> Path:
        """What the command of a point printed on standard output."""
        return self._beside(point, ".out")

    def plan(self, sweep: Sweep) -> Path:
        """The copy of a sweep's file."""
        return self.state / "plans" / f"{sweep.sha256[:16]}.toml"

    def keep_plan(self, sweep: Sweep) -> Path:
        """Write the copy of a sweep's file, and return its absolute path."""
        path = self.plan(sweep).resolve()
        write_whole(path, sweep.text, raises=RunError)
        return path

    def check_free(self) -> None:
        """Raise RunError if the folder holds files of something else."""
        if not self.state.is_dir():
            check_new(self.path)

    def record(self, point: SweepPoint) -> PointRecord | None:
        """The record of a point; None before it has begun.

        Raises:
            RunError: If it cannot be read.
        """
        path = self._beside(point, ".json")
        try:
            return section_from_mapping(PointRecord, read_json(path))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, ConfigError) as error:
            raise RunError(f"{path} cannot be read: {error}") from error

    def record_of(self, point: SweepPoint, sha256: str) -> PointRecord | None:
        """The record of a point that runs what `sha256` says; None before it has begun.

        Raises:
            RunError: If the point's folder holds another run.
        """
        record = self.record(point)
        if record is None or record.sha256 == sha256:
            return record
        # What failed may be put right; the command checks whether it can use what lies there.
        if record.state == "failed" or not self.out(point).exists():
            return None
        raise RunError(
            f"{self.out(point)} is of another sweep: its options, inputs or version of readygo differ; choose another "
            "folder with --out, or remove this one."
        )

    def write(self, point: SweepPoint, record: PointRecord) -> None:
        """Write the record of a point, in one piece."""
        write_json(self._beside(point, ".json"), section_to_mapping(record), raises=RunError)

    @contextmanager
    def lock(self, point: SweepPoint, *, patience_s: float) -> Iterator[bool]:
        """Lock a point; False if another process still runs it after `patience_s` [s]."""
        with held(self._beside(point, ".lock"), patience_s=patience_s) as lock:
            yield lock is not None

    @contextmanager
    def lock_all(self, *, patience_s: float) -> Iterator[bool]:
        """Lock the joined results."""
        with held(self.state / "lock", patience_s=patience_s) as lock:
            yield lock is not None

    def runs(self, point: SweepPoint) -> bool:
        """True if a process on this machine, or on one whose file system shares locks, runs a point."""
        if not self._beside(point, ".lock").exists():
            return False
        with self.lock(point, patience_s=0.0) as free:
            return not free

    def _beside(self, point: SweepPoint, ending: str) -> Path:
        place = self.points / point.name
        return place.with_name(place.name + ending)
