"""Stages of a job on disk: each makes a folder that is there whole or not at all, and is not made twice."""

import errno
import functools
import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.common.documents import read_json, write_json
from readygo.common.errors import ReadygoError, RunError
from readygo.common.files import remove_unfinished, unfinished_folder, write_whole
from readygo.common.locks import held

STAGE_FILE, BEGUN_FILE, LOCK_FILE = "stage.json", "begun", ".lock"
ROOM_MIN_BYTES = 256 << 20
"""A stage does not begin with less room on the disk."""
_FULL_BYTES = 4 << 20
"""A failure with less room on the disk than this counts as a full disk [bytes]."""
_AGAIN = "run the same command again; what is finished stays."
_MEMORY_WORDS = ("bad_alloc", "can't allocate memory", "cannot allocate memory", "insufficient memory", "out of memory")
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@dataclass(frozen=True, kw_only=True)
class StageProgress:
    """How far a job is."""

    stage: str
    share: float = 0.0
    """Finished share of the stage, 0 to 1."""
    words: str = ""
    picture: Path | None = None
    """The latest picture of what is being made."""


def identity_of(files: list[Path]) -> tuple[tuple[str, int, int], ...]:
    """Name, size and time of change of each file that is there."""
    return tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files if path.is_file())


@functools.cache
def code_digest(*parts: str) -> str:
    """Hash of the reconstructor's own code, so that what older code made is not mixed with what newer code makes.

    Args:
        parts: Folders of the service, as "poses"; "." are the files beside them.
    """
    here, digest = Path(__file__).parent, hashlib.sha256()
    for part in parts:
        for path in sorted((here / part).glob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


Say = Callable[[StageProgress], None]
Make = Callable[[Path], Mapping[str, Any]]


class Stages:
    """The stages of one job, in order.

    A stage is made again when its settings, its code, or a stage before it changed.
    """

    def __init__(self, folder: Path, say: Say) -> None:
        """Begin a job, or resume it.

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
        with held(self.folder / LOCK_FILE) as lock:
            if lock is None:
                raise RunError(f"{self.folder}: another command works here; wait for it, or choose another folder.")
            remove_unfinished(self.folder)
            try:
                yield
            finally:
                if [path.name for path in self.folder.iterdir()] == [LOCK_FILE]:
                    shutil.rmtree(self.folder, ignore_errors=True)

    def run(
        self, name: str, settings: Mapping[str, Any], make: Make, *, code: str = "", keep: bool = False
    ) -> dict[str, Any]:
        """Make a stage's folder unless it is there already.

        Args:
            name: Name of the stage, and of its folder.
            settings: All that its result depends on, besides the stages before.
            make: Fills a folder and says what it found, as values that JSON holds.
            code: What makes it, as of `code_digest`.
            keep: The folder stays when `make` is interrupted, and the next call with the same settings resumes from it.

        Returns:
            What was found, now or then.

        Raises:
            ReadygoError: If the stage cannot be finished; its folder is removed, or kept to resume from.
        """
        text = self._key + name + code + json.dumps(settings, sort_keys=True)
        self._key = hashlib.sha256(text.encode()).hexdigest()
        path = self.folder / name
        done = self._finished_facts(path)
        if done is None:
            self._check_ours(path)
            self._say(StageProgress(stage=name))
            self._check_room()
            done = self._keep_folder(path, make) if keep else self._whole(path, make)
        self.seconds[name] = float(done["seconds"])
        return dict(done["found"])

    def _whole(self, path: Path, make: Make) -> dict[str, Any]:
        """Make a folder that vanishes if it is not finished."""
        with unfinished_folder(path, good=lambda: self._finished_facts(path) is not None) as folder:
            return self._make_folder(folder, make)

    def _keep_folder(self, path: Path, make: Make) -> dict[str, Any]:
        """Make a folder that stays as it is if it is not finished; one that was begun otherwise goes."""
        begun = path / BEGUN_FILE
        if path.is_dir() and (not begun.is_file() or begun.read_text() != self._key):
            shutil.rmtree(path)
        path.mkdir(parents=True, exist_ok=True)
        write_whole(begun, self._key)
        (path / STAGE_FILE).unlink(missing_ok=True)
        return self._make_folder(path, make)

    def _make_folder(self, folder: Path, make: Make) -> dict[str, Any]:
        begin_s = time.monotonic()
        with word_errors(self.folder):
            found = json.loads(json.dumps(make(folder)))
        done = {"key": self._key, "seconds": round(time.monotonic() - begin_s, 2), "found": found}
        write_json(folder / STAGE_FILE, done, raises=ReadygoError)
        return done

    def _check_ours(self, path: Path) -> None:
        """Raise RunError for a folder that no stage has made, such as a user's, which would be replaced."""
        if path.exists() and not any((path / name).is_file() for name in (STAGE_FILE, BEGUN_FILE)):
            raise RunError(f"{path} is there already, and no stage of a job; choose another folder for the job.")

    def _check_room(self) -> None:
        free = shutil.disk_usage(self.folder).free
        if free < ROOM_MIN_BYTES:
            raise RunError(
                f"{self.folder}: {free >> 20} MB are left on the disk, {ROOM_MIN_BYTES >> 20} MB are needed. "
                f"Make room and {_AGAIN}"
            )

    def _finished_facts(self, path: Path) -> dict[str, Any] | None:
        """What a finished stage found; None if it is not there, or was made from something else."""
        try:
            done = read_json(path / STAGE_FILE)
        except (OSError, ValueError):
            return None
        return done if isinstance(done, dict) and done.get("key") == self._key else None


@contextmanager
def word_errors(folder: Path) -> Iterator[None]:
    """Say what ran out in a job's folder while a stage was made: C++ libraries name it in other words, or not at all.

    Raises:
        RunError: If memory or the disk ran out.
    """
    try:
        yield
    except Exception as error:
        words = str(error)
        if _errno(error) in _DISK_ERRORS or shutil.disk_usage(folder).free < _FULL_BYTES:
            # Our own errors give advice already.
            why = "" if isinstance(error, ReadygoError) else f" ({words})"
            raise RunError(f"The disk of {folder} is full{why}. Make room and {_AGAIN}") from error
        if isinstance(error, MemoryError) or any(each in words.lower() for each in _MEMORY_WORDS):
            raise RunError(
                "Memory ran out: close other programs, or take fewer images (--frames.count-max) or a smaller "
                "--preset, and "
                f"{_AGAIN}"
            ) from error
        raise


def _errno(error: BaseException) -> int | None:
    """The system's number of an error, or of what our own error was made of."""
    cause = error.__cause__ if isinstance(error, ReadygoError) and error.__cause__ else error
    return getattr(cause, "errno", None)
