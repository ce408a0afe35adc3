"""Copies finished shards to an object store, or any other fsspec file system, and verifies them by reading back."""

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from readygo.common.dataset.index import index_path, load_index, read_index
from readygo.common.dataset.places import find_shards
from readygo.common.documents import parse_json
from readygo.common.errors import RunError
from readygo.common.extras import install_command

LIST = "shards.json"
"""File with the names, sizes and SHA-256 of the store's files; written last, so that all listed files are complete."""
BLOCK_BYTES = 2**22
Told = Callable[[str, str], object]
"""Called with the name of a file and the action."""


def hand_over(data: Path, url: str, *, every_byte: bool = False, told: Told = lambda name, done: None) -> int:
    """Copy the finished shards of a data folder, and their indexes, to a store that may have some of them already.

    A shard that only the store has is removed from it if all its episodes are in shards of the folder: recovery has
    dropped it, or saved it under another name. Other shards stay, also those of other folders.

    Args:
        data: Data folder.
        url: Folder of the store, such as s3://bucket/lobby.
        every_byte: True also verifies files that the store's list names.
        told: Called with the name and the action of every file.

    Returns:
        Number of copied files.

    Raises:
        RunError: If the store cannot be used, or returns different data.
    """
    shards = find_shards(data)
    files = [path for shard in shards for path in (shard, index_path(shard)) if path.exists()]
    names = [path.name for path in files]
    if double := {name for name in names if names.count(name) > 1}:
        raise RunError(f"{data} has two shards called {min(double)}: they cannot be in one store.")
    system, folder = _opened(url)
    try:
        count = _copied(system, folder, files, every_byte=every_byte, told=told)
        _drop_replaced(system, folder, shards, told)
        return count
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
        # After every file, so that an interrupted copy resumes behind it.
        _write_list(system, folder, listed)
        told(file.name, "copied")
        count += 1
    return count


def _drop_replaced(system: Any, folder: str, shards: list[Path], told: Told) -> None:
    """Remove the shards from a store whose episodes are all in other shards of the data folder."""
    listed, here = _listed(system, f"{folder}/{LIST}"), {shard.name for shard in shards}
    gone = [name for name in listed if name.endswith(".mcap") and name not in here]
    if not gone:
        return
    kept = {sha256 for shard in shards for sha256 in load_index(shard).episodes["sha256"].tolist()}
    for name in gone:
        if not (held := _episodes(system, folder, name)) or held - kept:
            continue
        names = (name, index_path(Path(name)).name)
        listed = {other: entry for other, entry in listed.items() if other not in names}
        # The list is written first: it must name only existing files.
        _write_list(system, folder, listed)
        for place in (f"{folder}/{each}" for each in names):
            system.rm_file(place)
        told(name, "removed: its episodes are in other shards")


def _episodes(system: Any, folder: str, shard: str) -> set[bytes]:
    """SHA-256 of the episodes in a shard of a store, from its index; empty without an index."""
    name = index_path(Path(shard)).name
    if not system.exists(f"{folder}/{name}"):
        return set()
    with tempfile.TemporaryDirectory() as place:
        system.get_file(f"{folder}/{name}", str(Path(place, name)))
        index = read_index(Path(place, name))
    return set() if index is None else set(index.episodes["sha256"].tolist())


def _write_list(system: Any, folder: str, listed: dict[str, Any]) -> None:
    system.pipe_file(f"{folder}/{LIST}", json.dumps(listed, indent=1).encode())


def _listed(system: Any, place: str) -> dict[str, Any]:
    if not system.exists(place):
        return {}
    listed = parse_json(system.cat_file(place))
    if not isinstance(listed, dict):
        raise ValueError(f"{place} is no list of shards")
    return listed


def _size(system: Any, place: str) -> int:
    system.invalidate_cache()
    return int(system.size(place)) if system.exists(place) else -1


def _stored(system: Any, place: str) -> dict[str, Any]:
    """Size and hash of a file, read back from the store."""
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
