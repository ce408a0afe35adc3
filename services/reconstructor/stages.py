"""Stages of a job on disk: each makes a folder that is there whole or not at all, and is not made twice."""

import fcntl
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from readygo.common.errors import RunError
from readygo.common.files import unfinished_folder

STAGE_FILE, LOCK_FILE = "stage.json", ".lock"

Say = Callable[[str], None]


class Stages:
    """The stages of one job, in order; a stage is made again when its settings or a stage before it changed."""

    def __init__(self, folder: Path, say: Say) -> None:
        """Begin a job, or go on with it.

        Args:
            folder: State folder of the job.
            say: Hears one line per stage.
        """
        self.folder = folder
        self.seconds: dict[str, float] = {}
        self._say = say
        self._key = ""

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other commands out of the folder, and remove what a killed one left half done.

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
            yield

    def run(self, name: str, settings: Mapping[str, Any], make: Callable[[Path], Mapping[str, Any]]) -> dict[str, Any]:
        """Make a stage's folder unless it is there already.

        Args:
            name: Of the stage, and of its folder.
            settings: All that its result depends on, besides the stages before.
            make: Fills a folder and says what it found, as values that JSON holds.

        Returns:
            What was found, now or then.

        Raises:
            ReadygoError: If the stage cannot be finished; its folder is not there then.
        """
        self._key = hashlib.sha256((self._key + name + json.dumps(settings, sort_keys=True)).encode()).hexdigest()
        path = self.folder / name
        done = self._done(path)
        if done is None:
            self._say(name)
            begin_s = time.monotonic()
            with unfinished_folder(path, good=lambda: self._done(path) is not None) as folder:
                found = json.loads(json.dumps(make(folder)))
                done = {"key": self._key, "seconds": round(time.monotonic() - begin_s, 2), "found": found}
                (folder / STAGE_FILE).write_text(json.dumps(done, indent=2) + "\n")
        self.seconds[name] = float(done["seconds"])
        return dict(done["found"])

    def _done(self, path: Path) -> dict[str, Any] | None:
        """What a finished stage found; None if it is not there, or was made from something else."""
        try:
            done = json.loads((path / STAGE_FILE).read_text())
        except (OSError, ValueError):
            return None
        return done if isinstance(done, dict) and done.get("key") == self._key else None
