"""The hash of what a point runs: command, options, content of its scenes and files, version of readygo."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from readygo.apps.sweep.plan import SCENE_FIELDS, Sweep, SweepPoint
from readygo.common.avatars.cast import EMBEDDED
from readygo.common.errors import ConfigError
from readygo.runs.benchmark.suite import open_suite
from readygo.runs.method_files import method_hashes
from readygo.runs.scene_argument import open_scene


def point_sha256(sweep: Sweep, point: SweepPoint) -> str:
    """The hash of what a point runs: equal hashes are equal runs, wherever their inputs lie.

    Raises:
        ReadygoError: If an input is missing or cannot be read.
    """
    options = sweep.read(point)
    inputs = dict(_inputs(options))
    what = {
        "command": sweep.file.command,
        "options": [inputs.get(str(Path(word)), word) for word in point.words],
        "drivers": dict(_drivers(options)),
        "readygo": importlib.metadata.version("readygo"),
    }
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()


def _inputs(options: Any) -> Iterator[tuple[str, str]]:
    """The hash of each scene, suite, file and folder that the options name, by the word that names it."""
    fields = {each.name: getattr(options, each.name) for each in dataclasses.fields(options)}
    for name, value in fields.items():
        if dataclasses.is_dataclass(value):
            yield from _inputs(value)
        for each in value if isinstance(value, tuple) else (value,):
            if name in SCENE_FIELDS and each:
                yield str(Path(each)), _scene_sha256(str(each))
            elif name == "suite":
                yield each, open_suite(each).sha256
            elif name == "checkpoints":
                # The drivers in it have hashes of their files.
                yield str(each), name
            elif isinstance(each, Path) and name != "out" and not _is_embedded(each):
                whole = _without_part(each)
                yield str(each), content_sha256(whole) + str(each).removeprefix(str(whole))


def _drivers(options: Any) -> Mapping[str, str]:
    """Hashes of the files of an evaluation's or a benchmark's drivers."""
    names: Sequence[str] = getattr(options, "drivers", getattr(options, "methods", ()))
    place = getattr(getattr(options, "trials", options), "checkpoints", None)
    return method_hashes(names, place) if place is not None else {}


def _is_embedded(path: Path) -> bool:
    return str(path).partition(":")[0] == EMBEDDED


def _without_part(path: Path) -> Path:
    """Avatars without the part that is chosen: "people:train" is the folder people."""
    return path if path.exists() else Path(str(path).rpartition(":")[0] or path)


@functools.cache
def _scene_sha256(scene: str) -> str:
    return open_scene(scene).content_hash


@functools.cache
def content_sha256(path: Path) -> str:
    """The hash of a file's content, or of the names and contents of all files in a folder that are not hidden.

    Raises:
        ConfigError: If there is no such file or folder.
    """
    if path.is_dir():
        digest = hashlib.sha256()
        for file in sorted(_files(path)):
            digest.update(f"{file.relative_to(path).as_posix()} {_file_sha256(file)}\n".encode())
        return digest.hexdigest()
    if not path.is_file():
        raise ConfigError(f"The input {path} does not exist.")
    return _file_sha256(path)


def _files(folder: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield from (Path(place) / name for name in names if not name.startswith("."))


def _file_sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
