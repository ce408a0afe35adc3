"""Stages of a job on disk: each makes a folder that is there whole or not at all, and is not made twice."""

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.common.errors import RunError
from readygo.common.files import unfinished_folder, write_whole

STAGE_FILE, LOCK_FILE = "stage.json", ".lock"
ROOM_MIN_BYTES = 256 << 20
"""A stage does not begin with less room on the disk."""


@dataclass(frozen=True, kw_only=True)
class StageProgress:
    """How far a job is."""

    stage: str
    share: float = 0.0
    """Of the stage, 0 to 1."""
    words: str = ""
    picture: Path | None = None
    """The latest picture of what is being made."""


Say = Callable[[StageProgress], None]
Make = Callable[[Path], Mapping[str, Any]]


class Stages:
    """The stages of one job, in order; a stage is made again when its settings or a stage before it changed."""

    def __init__(self, folder: Path, say: Say) -> None:
        """Begin a job, or go on with it.

        Args:
            folder: State folder of the job.
            say: Hears when a stage begins.
        """
        self.folder = folder
        self.seconds: dict[str, float] = {}
        self._say = say
        self._key = ""

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other commands out of the folder, and remove what a killed one left; all of it if nothing is done.

        Raises:
            RunError: If another command works there.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / LOCK_FILE).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise RunError(
                    f"{self.folder}: another command works here; wait for it, or choose another folder."
                ) from error
            for remains in self.folder.glob(".*-*/"):
                shutil.rmtree(remains, ignore_errors=True)
            try:
                yield
            finally:
                if [path.name for path in self.folder.iterdir()] == [LOCK_FILE]:
                    shutil.rmtree(self.folder, ignore_errors=True)

    def run(self, name: str, settings: Mapping[str, Any], make: Make, *, keep: bool = False) -> dict[str, Any]:
        """Make a stage's folder unless it is there already.

        Args:
            name: Of the stage, and of its folder.
            settings: All that its result depends on, besides the stages before.
            make: Fills a folder and says what it found, as values that JSON holds.
            keep: The folder stays when `make` is interrupted; it knows itself what of it can be used.

        Returns:
            What was found, now or then.

        Raises:
            ReadygoError: If the stage cannot be finished; its folder is not there then, or kept to go on.
        """
        self._key = hashlib.sha256((self._key + name + json.dumps(settings, sort_keys=True)).encode()).hexdigest()
        path = self.folder / name
        done = self._done(path)
        if done is None:
            self._say(StageProgress(stage=name))
            self._check_room()
            done = self._kept(path, make) if keep else self._whole(path, make)
        self.seconds[name] = float(done["seconds"])
        return dict(done["found"])

    def _whole(self, path: Path, make: Make) -> dict[str, Any]:
        """Make a folder that vanishes if it is not finished."""
        with unfinished_folder(path, good=lambda: self._done(path) is not None) as folder:
            return self._made(folder, make)

    def _kept(self, path: Path, make: Make) -> dict[str, Any]:
        """Make a folder that stays as it is if it is not finished."""
        path.mkdir(parents=True, exist_ok=True)
        (path / STAGE_FILE).unlink(missing_ok=True)
        return self._made(path, make)

    def _made(self, folder: Path, make: Make) -> dict[str, Any]:
        begin_s = time.monotonic()
        found = json.loads(json.dumps(make(folder)))
        done = {"key": self._key, "seconds": round(time.monotonic() - begin_s, 2), "found": found}
        write_whole(folder / STAGE_FILE, (json.dumps(done, indent=2) + "\n").encode())
        return done

    def _check_room(self) -> None:
        free = shutil.disk_usage(self.folder).free
        if free < ROOM_MIN_BYTES:
            raise RunError(
                f"{self.folder}: {free >> 20} MB are left on the disk, {ROOM_MIN_BYTES >> 20} MB are needed to go on. "
                "Make room and run the same command again; what is finished stays."
            )

    def _done(self, path: Path) -> dict[str, Any] | None:
        """What a finished stage found; None if it is not there, or was made from something else."""
        try:
            done = json.loads((path / STAGE_FILE).read_text())
        except (OSError, ValueError):
            return None
        return done if isinstance(done, dict) and done.get("key") == self._key else None
