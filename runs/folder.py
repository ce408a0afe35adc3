"""A run's data folder."""

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from readygo.common.dataset.places import own_folders, shard_folders
from readygo.common.dataset.writer import recorder_of_shard
from readygo.common.errors import MessageError, RunError, cause
from readygo.common.files import write_whole
from readygo.common.locks import held
from readygo.common.messages import RunSpec, decode, encode
from readygo.runs.identity import identity

STATE_FOLDER = ".readygo"
TARGETS = "targets"
"""Folder in a run's state with a file per process that names its metrics' endpoint, for Prometheus' file_sd."""
PRIVATE, PASSABLE = 0o700, 0o711
"""Modes of a run's state: private to the owner, and passable for another user to known paths in it."""


@dataclass(frozen=True)
class RunFolder:
    """A data folder: finished shards on top, the run's state below `.readygo`."""

    path: Path

    @property
    def state(self) -> Path:
        """Folder of ledger, blobs, logs and spec."""
        return self.path / STATE_FOLDER

    @property
    def ledger(self) -> Path:
        """Path of the ledger."""
        return self.state / "ledger.sqlite"

    @property
    def blobs(self) -> Path:
        """Folder of the results between the stages."""
        return self.state / "blobs"

    @property
    def elsewhere(self) -> Path:
        """A file that exists once recorders on other machines have taken part in the run."""
        return self.state / "elsewhere"

    @property
    def retired(self) -> Path:
        """A file with the names of retired recorders, one per line, in case the ledger is lost."""
        return self.state / "retired"

    @property
    def aside(self) -> Path:
        """Folder with reasons and scenarios of the episodes that were set aside."""
        return self.state / "aside"

    @property
    def logs(self) -> Path:
        """Folder of the logs of the fleet's processes."""
        return self.state / "logs"

    @property
    def places(self) -> list[Path]:
        """Folders of the run's shards: this one, and those of recorders with separate disks.

        Raises:
            DatasetError: If the disk of a recorder is not there.
        """
        return shard_folders(self.path)

    def place_of(self, recorder: str) -> Path:
        """The folder that a recorder records into."""
        return own_folders(self.path).get(recorder, self.path)

    def shard(self, name: str) -> Path:
        """Path at which a shard of this name is, or should be."""
        return self.place_of(recorder_of_shard(name)) / name

    @property
    def begun(self) -> bool:
        """True if a run was begun in the folder, and this user may read the run's state."""
        return os.access(self.state / "spec.msgpack", os.R_OK)

    @property
    def has_data(self) -> bool:
        """True if the folder holds recorded data; False also after a failed start, which does not bind the next one."""
        noted = self.retired.exists() or _has_episodes(self.ledger)
        return noted or any(self.path.glob("shard-*.mcap*")) or bool(own_folders(self.path))

    def check(self, spec: RunSpec) -> None:
        """Check that this run may use the folder; changes nothing.

        Raises:
            RunError: If it is a file, or holds another run's data, or files of something else.
        """
        spec_file = self.state / "spec.msgpack"
        if self.path.is_file():
            raise RunError(f"--out {self.path} is a file; choose a new folder.")
        if spec_file.exists():
            if self.has_data:
                self._compare(self._spec(), spec)
        else:
            check_new(self.path, STATE_FOLDER)

    def check_other(self) -> None:
        """Check that what is no recorded data may be written into the folder; changes nothing.

        Raises:
            RunError: If it is a file, or holds recorded data.
        """
        if self.path.is_file():
            raise RunError(f"--out {self.path} is a file; choose a new folder.")
        if self.has_data:
            raise RunError(f"--out {self.path} holds recorded data; choose a new folder.")

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the folder, which is made if missing; the lock ends with the process in any case.

        Raises:
            RunError: If another process holds the lock, or the folder cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.state.mkdir(mode=PRIVATE, exist_ok=True)
            keep_private(self.state)
            self.logs.mkdir(exist_ok=True)
        except OSError as error:
            raise RunError(f"{self.path} cannot be written: {error.strerror}.") from error
        with held(self.state / "lock") as lock:
            if lock is None:
                raise RunError(f"Another process is generating into {self.path}; wait for it or stop it.")
            yield

    @contextmanager
    def lock_coordinator(self, *, patience_s: float) -> Iterator[None]:
        """Be the only coordinator of the run while the context is active.

        Args:
            patience_s: Time for another coordinator to end, for example after its parent has ended [s].

        Raises:
            RunError: If another coordinator stays, or the folder holds no run.
        """
        self.load()
        with held(self.state / "coordinator.lock", patience_s=patience_s) as lock:
            if lock is None:
                raise RunError(f"Another coordinator is at work on {self.path}; stop it first.")
            yield

    @contextmanager
    def reachable(self, endpoint: str, token: str) -> Iterator[None]:
        """Publish endpoint and token of the run's fleet in a file while the context is active.

        Only the folder's owner can read the file.
        """
        file = self.state / "endpoint"
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
            stream.write(f"{endpoint}\n{token}\n")
        try:
            yield
        finally:
            (self.state / "endpoint").unlink(missing_ok=True)

    def fleet_endpoint(self) -> tuple[str, str]:
        """Endpoint and token of the fleet that works on the run.

        Raises:
            RunError: If no fleet works on the run.
        """
        try:
            endpoint, token, *_ = [*(self.state / "endpoint").read_text().splitlines(), "", ""]
        except (OSError, UnicodeDecodeError) as error:
            raise RunError(f"No fleet is at work on {self.path}.") from error
        return endpoint, token

    def save(self, spec: RunSpec, wanted: int) -> None:
        """Write the run's spec and the number of wanted episodes.

        Raises:
            RunError: If the folder cannot be written.
        """
        write_whole(self.state / "spec.msgpack", encode(spec), raises=RunError)
        write_whole(self.state / "wanted", str(wanted), raises=RunError)

    def load(self) -> tuple[RunSpec, int]:
        """The run's spec and the number of wanted episodes."""
        spec, file = self._spec(), self.state / "wanted"
        try:
            return spec, int(file.read_text())
        except OSError as error:
            raise RunError(f"{file} cannot be read: {cause(error)}.") from error
        except ValueError as error:
            raise RunError(f"{file} is damaged: write the number of wanted episodes into it ({error}).") from error

    def _spec(self) -> RunSpec:
        file = self.state / "spec.msgpack"
        try:
            return decode(RunSpec, file.read_bytes())
        except (FileNotFoundError, NotADirectoryError) as error:
            raise RunError(f"{self.path} holds no recorded run; record one with `readygo generate`.") from error
        except OSError as error:
            raise RunError(f"{file} cannot be read: {cause(error)}.") from error
        except MessageError as error:
            raise RunError(
                f"{file} is damaged: {error} Restore it from a copy to resume the run; its shards can be read."
            ) from error

    def _compare(self, old: RunSpec, new: RunSpec) -> None:
        theirs, ours = identity(old), identity(new)
        different = [key for key in {**ours, **theirs} if theirs.get(key) != ours.get(key)]
        if "config" in different:
            sections = [name for name in ours["config"] if theirs["config"].get(name) != ours["config"][name]]
            different[different.index("config")] = f"config ({', '.join(sections) or 'sections'})"
        if different:
            raise RunError(
                f"{self.path} holds data of another run: {', '.join(different)} differ. "
                "Choose another --out, or the settings of that run to resume it."
            )


def check_new(folder: Path, *ours: str) -> None:
    """Check that a command may write its results into a folder.

    Args:
        folder: It need not be there.
        ours: Names of files that the command itself may have left there.

    Raises:
        RunError: If it holds other files.
    """
    if folder.exists() and any(entry.name not in ours for entry in folder.iterdir()):
        raise RunError(f"{folder} holds files of something else; choose an empty or new folder with --out.")


def keep_private(state: Path) -> None:
    """Remove other users' permissions on a run's state; Prometheus, another user, can still reach the targets.

    A process with write permission that is not the owner changes nothing.
    """
    with contextlib.suppress(PermissionError):
        state.chmod(PASSABLE if (state / TARGETS).exists() else PRIVATE)


def _has_episodes(ledger: Path) -> bool:
    """True if a ledger has episodes, or cannot be read."""
    if not ledger.exists():
        return False
    try:
        with contextlib.closing(sqlite3.connect(f"{ledger.resolve().as_uri()}?mode=ro", uri=True)) as database:
            return database.execute("SELECT 1 FROM episode LIMIT 1").fetchone() is not None
    except sqlite3.Error:
        return True
