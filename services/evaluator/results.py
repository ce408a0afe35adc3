"""The folder of an evaluation: every episode is on disk when it ends, and an interrupted evaluation resumes."""

import fcntl
import json
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.documents import parse_json, read_json, write_json
from readygo.common.errors import ReadygoError, RunError, cause
from readygo.common.messages import RobotTrajectory
from readygo.services.evaluator.records import EpisodeRecord, RecordKey, record_of_mapping

RECORDS_FILE = "episodes.jsonl"
TRAJECTORIES_FILE = "trajectories.jsonl"
SETTINGS_FILE = "settings.json"
SUMMARY_FILE = "summary.json"
DIFFERENCES_SHOWN = 3
_POSE_DIGITS = 5

METHODS = "methods"
"""Key of the settings that has a hash by method, of methods that are files; it grows with the methods that drive."""


class Results:
    """Records and trajectories of one evaluation; `open_results` makes it."""

    def __init__(self, folder: Path, records: BinaryIO, trajectories: BinaryIO) -> None:
        self.folder = folder
        self.records: dict[RecordKey, EpisodeRecord] = {}
        """All records on disk, by key."""
        self._records, self._trajectories = records, trajectories
        self.records |= {record.key: record for record in _read_records(records, folder / RECORDS_FILE)}
        for _ in _whole_lines(trajectories, folder / TRAJECTORIES_FILE):
            pass

    def keep(self, record: EpisodeRecord, trajectory: RobotTrajectory | None) -> None:
        """Write an episode that has ended; it is durable when this returns.

        Args:
            record: How it ended.
            trajectory: What the robot did; None if it did nothing.

        Raises:
            RunError: If it cannot be written; what was kept before stays.
        """
        try:
            if trajectory is not None:
                _append(self._trajectories, _trajectory_mapping(record.key, trajectory))
            _append(self._records, record.to_mapping())
        except OSError as error:
            raise RunError(
                f"{self.folder} cannot be written: {error.strerror or error}; {len(self.records)} episodes are kept, "
                "the same command resumes."
            ) from error
        self.records[record.key] = record

    def actions(self, keys: Collection[RecordKey]) -> dict[RecordKey, Float64Array]:
        """Commands that episodes were driven with: v [m/s], w [rad/s], shape (T, 2) each; they make a run once more.

        Episodes without a trajectory are left out.

        Raises:
            RunError: If a line is damaged.
        """
        if not keys:
            return {}
        wanted = {_key_names(key): key for key in keys}
        found, path = {}, self.folder / TRAJECTORIES_FILE
        for number, mapping in enumerate(_whole_lines(self._trajectories, path), start=1):
            try:
                key = wanted.get((mapping["episode"], mapping["task"], mapping["method"]))
                if key is not None:
                    found[key] = np.array(mapping["actions"], dtype=np.float64)
            except (KeyError, TypeError, ValueError) as error:
                raise RunError(f"{path} holds no trajectory in line {number}: {error!r}.") from error
        return found

    def settings(self) -> dict[str, Any]:
        """What records depend on besides their key.

        Raises:
            RunError: If they cannot be read.
        """
        try:
            return _read_settings(self.folder)
        except (OSError, ValueError) as error:
            raise RunError(f"{self.folder / SETTINGS_FILE} cannot be read: {cause(error)}.") from error

    def sees(self) -> tuple[str, ...]:
        """Images by which the policy drove, as the summary names them; none if it names none."""
        try:
            names = read_json(self.folder / SUMMARY_FILE)["sees"]
        except (OSError, ValueError, LookupError, TypeError):
            return ()
        return tuple(name for name in names if isinstance(name, str)) if isinstance(names, list) else ()

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write `summary.json`, in one piece.

        Raises:
            ReadygoError: If it cannot be written.
        """
        write_json(self.folder / SUMMARY_FILE, summary, raises=ReadygoError)


@contextmanager
def read_results(folder: Path) -> Iterator[Results]:
    """The results of an evaluation, to be looked at.

    Args:
        folder: Of the evaluation; it stays as it is.

    Raises:
        RunError: If it holds none, or they cannot be read.
    """
    with ExitStack() as files:
        try:
            records, trajectories = (
                files.enter_context((folder / name).open("rb", buffering=0))
                for name in (RECORDS_FILE, TRAJECTORIES_FILE)
            )
        except OSError as error:
            raise RunError(f"{folder} holds no results: {error.strerror or error}.") from error
        yield Results(folder, records, trajectories)


@contextmanager
def open_results(folder: Path, settings: Mapping[str, Any]) -> Iterator[Results]:
    """Begin an evaluation in a folder, or resume the one that is there.

    Args:
        folder: Made if it is missing.
        settings: All that records depend on besides their key, as plain values; written when the folder is new. Below
            `METHODS` only the methods count that the folder names as well; it names the others from now on.

    Raises:
        RunError: If the folder has results of other settings or of unknown ones, another process is at work in it, or
            it cannot be read or written.
    """
    with ExitStack() as files:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _check_settings(folder, settings)
            records, trajectories = (
                files.enter_context((folder / name).open("a+b", buffering=0))
                for name in (RECORDS_FILE, TRAJECTORIES_FILE)
            )
            _lock(records, folder)
            results = Results(folder, records, trajectories)
        except OSError as error:
            raise RunError(f"{folder} cannot be written: {error.strerror or error}.") from error
        yield results


def is_of(folder: Path, settings: Mapping[str, Any]) -> bool:
    """True if `open_results` would resume in a folder."""
    try:
        return not _differences(_read_settings(folder), settings)
    except (OSError, ValueError):
        return False


def _check_settings(folder: Path, settings: Mapping[str, Any]) -> None:
    """Compare with what the folder was begun with, or say what it is begun with."""
    try:
        kept = _read_settings(folder)
    except FileNotFoundError as error:
        if any((folder / name).exists() for name in (RECORDS_FILE, SUMMARY_FILE)):
            raise RunError(f"{folder} has results that do not say how they came; choose another --out.") from error
        write_json(folder / SETTINGS_FILE, settings, raises=RunError)
        return
    except ValueError as error:
        raise RunError(f"{folder / SETTINGS_FILE} cannot be read: {cause(error)}; choose another --out.") from error
    different = _differences(kept, settings)
    if different:
        more = f" and {len(different) - DIFFERENCES_SHOWN} more" if len(different) > DIFFERENCES_SHOWN else ""
        raise RunError(
            f"{folder} has results of other settings: {', '.join(different[:DIFFERENCES_SHOWN])}{more}. Choose another "
            "--out, or those settings to resume."
        )
    methods = kept.get(METHODS, {})
    if new := {name: sha256 for name, sha256 in settings.get(METHODS, {}).items() if name not in methods}:
        write_json(folder / SETTINGS_FILE, {**kept, METHODS: {**methods, **new}}, raises=RunError)


def _read_settings(folder: Path) -> dict[str, Any]:
    settings = read_json(folder / SETTINGS_FILE)
    if not isinstance(settings, dict) or not isinstance(settings.get(METHODS, {}), dict):
        raise ValueError("it holds no settings")
    return settings


def _differences(kept: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    theirs, ours = _flat(_of_common_methods(kept, asked)), _flat(_of_common_methods(asked, kept))
    return [
        f"{name} {_short(theirs.get(name))} (now: {_short(ours.get(name))})"
        for name in {**theirs, **ours}
        if theirs.get(name) != ours.get(name)
    ]


def _of_common_methods(settings: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as JSON has them, with the methods alone that both name."""
    plain: dict[str, Any] = json.loads(json.dumps(settings))
    methods, named = plain.pop(METHODS, {}), others.get(METHODS, {})
    return plain | {METHODS: {name: sha256 for name, sha256 in methods.items() if name in named}}


def _flat(mapping: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in mapping.items():
        flat |= _flat(value, f"{where}{name}.") if isinstance(value, Mapping) else {f"{where}{name}": value}
    return flat


def _short(value: Any) -> str:
    text = "none" if value in (None, "") else str(value)
    return text if len(text) <= 16 else f"{text[:12]}..."


def _lock(file: BinaryIO, folder: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise RunError(f"Another process is evaluating into {folder}; wait for it or stop it.") from error


def _whole_lines(file: BinaryIO, path: Path) -> Iterator[dict[str, Any]]:
    """The mappings of a file's lines; what a crash left of a line at its end is cut off."""
    file.seek(0)
    # At once: without a buffer, lines are read byte by byte.
    kept = file.read()
    whole, _, rest = kept.rpartition(b"\n")
    for number, line in enumerate(whole.split(b"\n") if whole else [], start=1):
        try:
            yield parse_json(line)
        except ValueError as error:
            raise RunError(f"{path} is broken in line {number}: {error}; choose another --out.") from error
    if rest and file.writable():
        file.truncate(len(kept) - len(rest))


def _read_records(file: BinaryIO, path: Path) -> Iterator[EpisodeRecord]:
    for number, mapping in enumerate(_whole_lines(file, path), start=1):
        try:
            yield record_of_mapping(mapping)
        except ValueError as error:
            raise RunError(f"{path} holds no record in line {number}: {error}; choose another --out.") from error


def _append(file: BinaryIO, mapping: Mapping[str, Any]) -> None:
    """Write a line durably, or nothing: others may follow it when the disk has room again."""
    rest = memoryview(json.dumps(mapping).encode() + b"\n")
    end = file.seek(0, os.SEEK_END)
    try:
        while rest:
            rest = rest[file.write(rest) :]
        os.fsync(file)
    except OSError:
        with suppress(OSError):
            file.truncate(end)
        raise


def _trajectory_mapping(key: RecordKey, trajectory: RobotTrajectory) -> dict[str, Any]:
    """Poses for those who draw them, and commands to the last bit: they make the run once more."""
    episode, task, method = _key_names(key)
    return {
        "episode": episode,
        "task": task,
        "method": method,
        "xyyaw": np.round(trajectory.xyyaw, _POSE_DIGITS).tolist(),
        "actions": trajectory.actions.tolist(),
    }


def _key_names(key: RecordKey) -> tuple[str, str, str]:
    task, method, episode = key
    return episode.episode_id, task.value, method
