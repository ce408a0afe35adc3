"""Recorders with separate disks: their folders, and the recovery from a lost disk."""

from pathlib import Path

from readygo.common.dataset.places import MARK, is_there, note_folders, own_folders
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.messages import RunSpec
from readygo.runs.config import config_of
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Ledger


def recorders_of(folder: RunFolder, spec: RunSpec) -> tuple[str, ...]:
    """The run's recorders, without retired ones; makes no ledger."""
    retired = _retired_in_ledger(folder, spec)
    return tuple(name for name in config_of(spec).coordinator.recorders if name not in retired)


def prepare_folders(folder: RunFolder, spec: RunSpec) -> None:
    """Make the separate folders of the run's recorders, and record their paths.

    Call it with the folder's lock, after `recover`, which raises if a disk of the run is missing.

    Raises:
        RunError: If a folder cannot be used.
    """
    retired = _retired_in_ledger(folder, spec)
    known = own_folders(folder.path)
    wanted = {name: Path(place).resolve() for name, place in config_of(spec).coordinator.folders.items()}
    folders = {name: place for name, place in {**known, **wanted}.items() if name not in retired}
    for name in folders.keys() - known.keys():
        _take(folder, name, folders[name], spec.run)
    note_folders(folder.path, folders, raises=RunError)


def requeue(folder: RunFolder, recorder: str) -> int:
    """Retire a recorder whose disk is lost; call it with the folder's lock.

    Returns:
        Number of episodes on the disk or pending for it, which are recorded again when the run resumes.

    Raises:
        RunError: If the run has no such recorder with a separate disk or on another machine, or its disk is there.
    """
    known = own_folders(folder.path)
    spec, _ = folder.load()
    # A lost ledger is rebuilt first: an empty one would have all episodes recorded again.
    remote = recorders_of(folder, spec) if folder.elsewhere.exists() and folder.ledger.exists() else ()
    if remote and recorder not in (*known, *remote):
        raise RunError(f"{folder.path} has no recorder {recorder!r}; it has {', '.join(remote)}.")
    if recorder not in (*known, *remote):
        has = f"those that have: {', '.join(known)}" if known else "none has one"
        raise RunError(
            f"{folder.path} has no recorder {recorder!r} with a separate folder ({has}). What is lost or damaged in "
            f"the data folder itself is recorded again by `readygo recover {folder.path}`."
        )
    if recorder in known and is_there(known[recorder]):
        raise RunError(
            f"The folder of recorder {recorder}, {known[recorder]}, is there: `readygo recover {folder.path}` saves "
            "what is whole in it and records the rest again. To give it up nevertheless, unmount or move it first."
        )
    ledger = Ledger(folder.ledger, spec.stages)
    try:
        _note_retired(folder, _read_retired(folder) | ledger.retired_recorders() | {recorder})
        count = ledger.retire(recorder)
    finally:
        ledger.close()
    note_folders(folder.path, {name: place for name, place in known.items() if name != recorder}, raises=RunError)
    return count


def keep_retired(folder: RunFolder, ledger: Ledger) -> None:
    """Add the retired recorders to a ledger that was rebuilt, or restored from an older copy.

    Raises:
        RunError: If the folder cannot be read or written.
    """
    noted, known = _read_retired(folder), ledger.retired_recorders()
    for recorder in sorted(noted - known):
        ledger.retire(recorder)
    if known - noted:
        _note_retired(folder, noted | known)


def _read_retired(folder: RunFolder) -> set[str]:
    try:
        return set(folder.retired.read_text().split())
    except FileNotFoundError:
        return set()
    except (OSError, ValueError) as error:
        raise RunError(
            f"{folder.retired}, which names recorders that were given up, cannot be read: {error}."
        ) from error


def _note_retired(folder: RunFolder, recorders: set[str]) -> None:
    write_whole(folder.retired, "".join(f"{name}\n" for name in sorted(recorders)), raises=RunError)


def _retired_in_ledger(folder: RunFolder, spec: RunSpec) -> set[str]:
    if not folder.ledger.exists():
        return set()
    ledger = Ledger(folder.ledger, spec.stages)
    try:
        return ledger.retired_recorders()
    finally:
        ledger.close()


def _take(folder: RunFolder, recorder: str, place: Path, run: str) -> None:
    """Assign a folder to a recorder.

    Raises:
        RunError: If the folder belongs to another recorder, or the recorder has recorded elsewhere.
    """
    if any(folder.path.glob(f"shard-{recorder}-*")):
        raise RunError(
            f"Recorder {recorder} has recorded into {folder.path} itself: give one with a separate folder a new name."
        )
    owner = f"{run} {recorder}\n"
    try:
        place.mkdir(parents=True, exist_ok=True)
        mark = place / MARK
        if (mark.exists() and mark.read_text() != owner) or any(place.glob(f"shard-{recorder}-*")):
            raise RunError(f"{place} holds shards of another run or recorder: choose another folder for {recorder}.")
    except OSError as error:
        raise RunError(f"The folder of recorder {recorder}, {place}, cannot be used: {error.strerror}.") from error
    write_whole(mark, owner, raises=RunError)
