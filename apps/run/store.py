"""Finished shards in an object store, or any other place that fsspec knows: handed over, and read back to be sure."""

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from readygo.common.dataset.index import index_path
from readygo.common.dataset.reader import find_shards
from readygo.common.errors import RunError
from readygo.common.extras import install_command

LIST = "shards.json"
"""Names what is in the store, with size and SHA-256; written last, so that what it names is whole there."""
BLOCK_BYTES = 2**22
Told = Callable[[str, str], object]
"""Hears the name of a file and what was done about it."""


def hand_over(data: Path, url: str, *, every_byte: bool = False, told: Told = lambda name, done: None) -> int:
    """Copy the finished shards of a data folder, and their indexes, to a store that may have some of them already.

    Args:
        data: Data folder.
        url: Folder of the store, such as s3://bucket/lobby.
        every_byte: Read again also what the store's list names.
        told: Hears what becomes of every file.

    Returns:
        Files that were copied.

    Raises:
        RunError: If the store cannot be used, or what it gives back is not what it got.
    """
    shards = find_shards(data)
    files = [path for shard in shards for path in (shard, index_path(shard)) if path.exists()]
    names = [path.name for path in files]
    if double := {name for name in names if names.count(name) > 1}:
        raise RunError(f"{data} has two shards called {min(double)}: they cannot be in one store.")
    system, folder = _opened(url)
    try:
        return _copied(system, folder, files, every_byte=every_byte, told=told)
    except (OSError, ValueError) as error:
        raise RunError(f"The store {url} cannot be used: {error}.") from error


def _opened(url: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError as error:
        raise RunError(f"Object stores need fsspec: {install_command('store')}") from error
    try:
        system, folder = fsspec.core.url_to_fs(url)
    except (ValueError, ImportError) as error:
        raise RunError(f"The store {url} cannot be used: {error}") from error
    return system, str(folder).rstrip("/")


def _copied(system: Any, folder: str, files: list[Path], *, every_byte: bool, told: Told) -> int:
    listed, count = _listed(system, f"{folder}/{LIST}"), 0
    system.makedirs(folder, exist_ok=True)
    for file in files:
        place, entry = f"{folder}/{file.name}", {"size": file.stat().st_size, "sha256": _sha256(_blocks_of(file))}
        known = listed.get(file.name) == entry and _size(system, place) == entry["size"]
        if known and (not every_byte or _stored(system, place) == entry):
            told(file.name, "is there")
            continue
        system.put_file(str(file), place)
        if (stored := _stored(system, place)) != entry:
            raise RunError(f"{place} is not what was written: {stored}, not {entry}; nothing was removed here.")
        listed[file.name] = entry
        # After every file: who is interrupted goes on behind it.
        system.pipe_file(f"{folder}/{LIST}", json.dumps(listed, indent=1).encode())
        told(file.name, "copied")
        count += 1
    return count


def _listed(system: Any, place: str) -> dict[str, Any]:
    if not system.exists(place):
        return {}
    listed = json.loads(system.cat_file(place))
    if not isinstance(listed, dict):
        raise ValueError(f"{place} is no list of shards")
    return listed


def _size(system: Any, place: str) -> int:
    system.invalidate_cache()
    return int(system.size(place)) if system.exists(place) else -1


def _stored(system: Any, place: str) -> dict[str, Any]:
    """Size and hash of what the store gives back."""
    with system.open(place, "rb") as stream:
        return {"size": _size(system, place), "sha256": _sha256(iter(lambda: stream.read(BLOCK_BYTES), b""))}


def _blocks_of(file: Path) -> Iterator[bytes]:
    with file.open("rb") as stream:
        yield from iter(lambda: stream.read(BLOCK_BYTES), b"")


def _sha256(blocks: Iterator[bytes]) -> str:
    digest = hashlib.sha256()
    for block in blocks:
        digest.update(block)
    return digest.hexdigest()
