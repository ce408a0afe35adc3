"""Where the shards of a data folder are: in it, and in the folders of recorders that have a separate disk."""

import json
from collections.abc import Mapping
from pathlib import Path

from readygo.common.documents import read_json
from readygo.common.errors import DatasetError, ReadygoError, cause
from readygo.common.files import write_whole

NOTE = "recorders.json"
"""Names the folders of recorders that do not record into the data folder itself."""
MARK = ".readygo-recorder"
"""Lies in each of them: without it the disk is another one, or not mounted."""


def find_shards(folder: str | Path) -> list[Path]:
    """The finished shards of a folder, by name.

    Raises:
        DatasetError: If the folder is missing or has none.
    """
    folder = Path(folder)
    embedded = str(folder).partition(":")[0] == "embedded" and not folder.exists()
    if embedded or (folder / "scene.toml").is_file():
        raise DatasetError(f"{folder} is a scene, no data folder; look at it with `readygo scene inspect {folder}`.")
    if folder.is_file():
        raise DatasetError(f"{folder} is a file; name the data folder, which holds the shards.")
    if not folder.is_dir():
        raise DatasetError(f"Data folder {folder} does not exist; record one with `readygo generate`.")
    shards = [shard for place in shard_folders(folder) for shard in sorted(place.glob("shard-*.mcap"))]
    if not shards:
        open_count = len(list(folder.glob("shard-*.mcap.part")))
        hint = f"{open_count} are still being written" if open_count else "record some with `readygo generate`"
        raise DatasetError(f"Data folder {folder} holds no finished shards (shard-*.mcap); {hint}.")
    return shards


def own_folders(folder: Path) -> dict[str, Path]:
    """The folders that recorders of a data folder have for themselves, by recorder.

    Raises:
        DatasetError: If the note of them cannot be read.
    """
    note = folder / NOTE
    if not note.exists():
        return {}
    try:
        return {str(name): Path(place) for name, place in read_json(note).items()}
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise DatasetError(
            f"{note}, which says where recorders have their shards, cannot be read: {cause(error)}."
        ) from error


def note_folders(folder: Path, folders: Mapping[str, Path], *, raises: type[ReadygoError] = ReadygoError) -> None:
    """Write what `own_folders` reads."""
    plain = {name: str(place) for name, place in folders.items()}
    if plain or (folder / NOTE).exists():
        write_whole(folder / NOTE, json.dumps(plain, indent=1) + "\n", raises=raises)


def is_there(place: Path) -> bool:
    """True if a recorder's own folder can be read, and is not the place where its disk should be mounted."""
    return (place / MARK).is_file()


def shard_folders(folder: Path) -> list[Path]:
    """All folders with shards of a data folder, the folder itself first.

    Raises:
        DatasetError: If one is not there; the message says what to do.
    """
    if missing := absent(folder):
        raise DatasetError(missing)
    return present_folders(folder)


def present_folders(folder: Path) -> list[Path]:
    """Those of `shard_folders` that are there.

    Raises:
        DatasetError: If the note of the recorders' folders cannot be read.
    """
    return [folder, *filter(is_there, own_folders(folder).values())]


def absent(folder: Path) -> str:
    """Which of `shard_folders` is not there, and what to do; empty if all are.

    Raises:
        DatasetError: If the note of the recorders' folders cannot be read.
    """
    for name, place in own_folders(folder).items():
        if not is_there(place):
            return (
                f"The folder of recorder {name}, {place}, is not there: mount its disk, or have its episodes recorded "
                f"again: `readygo requeue {folder} --recorder {name}`."
            )
    return ""
