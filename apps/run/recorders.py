"""Recorders with a disk of their own: their folders, and what to do when one of the disks is gone."""

from pathlib import Path

from readygo.apps.run.config import config_of
from readygo.apps.run.folder import RunFolder
from readygo.common.dataset.places import MARK, is_there, note_folders, own_folders
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.messages import RunSpec
from readygo.services.coordinator import Ledger


def recorders_of(folder: RunFolder, spec: RunSpec) -> tuple[str, ...]:
    """The run's recorders, without those that were given up; makes no ledger."""
    retired = _retired(folder, spec)
    return tuple(name for name in config_of(spec).coordinator.recorders if name not in retired)


def prepare_folders(folder: RunFolder, spec: RunSpec) -> None:
    """Make the folders that the run's recorders have for themselves, and note where they are.

    Call it with the folder's lock, after `recover`, which refuses to go on without a disk that was there before.

    Raises:
        RunError: If one cannot be used.
    """
    retired = _retired(folder, spec)
    known = own_folders(folder.path)
    wanted = {name: Path(place).resolve() for name, place in config_of(spec).coordinator.folders.items()}
    folders = {name: place for name, place in {**known, **wanted}.items() if name not in retired}
    for name in folders.keys() - known.keys():
        _take(folder, name, folders[name], spec.run)
    note_folders(folder.path, folders, raises=RunError)


def requeue(folder: RunFolder, recorder: str) -> int:
    """Give a recorder up whose disk is gone; call it with the folder's lock.

    Returns:
        Episodes that were on the disk, or on their way to it: they are recorded again when the run goes on.

    Raises:
        RunError: If the run has no such recorder with a disk of its own, or its disk is there.
    """
    known = own_folders(folder.path)
    if recorder not in known:
        has = f"those that have: {', '.join(known)}" if known else "none has one"
        raise RunError(
            f"{folder.path} has no recorder {recorder!r} with a folder of its own ({has}). What is lost or damaged in "
            f"the data folder itself is recorded again by `readygo recover {folder.path}`."
        )
    if is_there(known[recorder]):
        raise RunError(
            f"The folder of recorder {recorder}, {known[recorder]}, is there: `readygo recover {folder.path}` saves "
            "what is whole in it and records the rest again. To give it up nevertheless, unmount or move it first."
        )
    spec, _ = folder.load()
    ledger = Ledger(folder.ledger, spec.stages)
    try:
        _note_retired(folder, _noted(folder) | ledger.retired() | {recorder})
        count = ledger.retire(recorder)
    finally:
        ledger.close()
    note_folders(folder.path, {name: place for name, place in known.items() if name != recorder}, raises=RunError)
    return count


def keep_retired(folder: RunFolder, ledger: Ledger) -> None:
    """Have a ledger that was made anew, or is of an earlier day, know the recorders that were given up.

    Raises:
        RunError: If the folder cannot be read or written.
    """
    noted, known = _noted(folder), ledger.retired()
    for recorder in sorted(noted - known):
        ledger.retire(recorder)
    if known - noted:
        _note_retired(folder, noted | known)


def _noted(folder: RunFolder) -> set[str]:
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


def _retired(folder: RunFolder, spec: RunSpec) -> set[str]:
    if not folder.ledger.exists():
        return set()
    ledger = Ledger(folder.ledger, spec.stages)
    try:
        return ledger.retired()
    finally:
        ledger.close()


def _take(folder: RunFolder, recorder: str, place: Path, run: str) -> None:
    """Make a folder a recorder's own.

    Raises:
        RunError: If it is that of another one already, or the recorder has recorded elsewhere.
    """
    if any(folder.path.glob(f"shard-{recorder}-*")):
        raise RunError(
            f"Recorder {recorder} has recorded into {folder.path} itself: give one with a folder of its own a new name."
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
