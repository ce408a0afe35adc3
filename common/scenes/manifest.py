"""`scene.toml`: what a bundle holds, where it comes from, and the hashes of its content."""

import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray
from readygo.common.documents import read_toml
from readygo.common.errors import SceneError, cause
from readygo.common.maps import GridFrame

MANIFEST = "scene.toml"
FORMAT = "readygo-scene/1"
_ALIKE_MIN = 0.75
_GAUSSIAN_ENDINGS = (".ply", ".splat", ".spz", ".ckpt", ".pt")
_OTHER_FOLDERS = {"shard-*.mcap*": "a data folder", "*policy.toml": "a policy"}
"""Kinds of folders that are taken for a scene, by a file in them."""


@dataclass(frozen=True, kw_only=True)
class SceneFile:
    """One file of a bundle."""

    path: str
    """Relative to the bundle, with forward slashes."""
    sha256: str
    size: int
    """Bytes."""


def file_of(folder: Path, relative: str) -> SceneFile:
    """Describe a file of a bundle; reads it once."""
    path = folder / relative
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return SceneFile(path=relative, sha256=digest, size=path.stat().st_size)


def grid_digest(cells: AnyArray, frame: GridFrame) -> str:
    """Hash of a grid's cells and place, which does not depend on how its file is compressed."""
    place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m, cells.shape, cells.dtype.str)
    return hashlib.sha256(repr(place).encode() + np.ascontiguousarray(cells).tobytes()).hexdigest()


def combined_hash(digests: Mapping[str, str]) -> str:
    """One hash of named digests; their order does not matter."""
    lines = "".join(f"{name} {digests[name]}\n" for name in sorted(digests))
    return hashlib.sha256(lines.encode()).hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """The parsed `scene.toml` of a bundle.

    Raises:
        SceneError: If `folder` is no bundle, its manifest is broken, or a file is missing or has another size.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise SceneError(f"{folder} {_no_bundle(folder)}.")
    try:
        manifest = read_toml(path)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path} cannot be read: {cause(error)}.") from error
    if manifest.get("format") != FORMAT:
        raise SceneError(f"{path} has format {manifest.get('format')!r}, not {FORMAT!r}; import the scene again.")
    _check(manifest, folder)
    return manifest


def _no_bundle(folder: Path) -> str:
    """What a path without a manifest is, and what to do."""
    if not folder.exists():
        if difflib.get_close_matches(str(folder).partition(":")[0], ["embedded"], cutoff=_ALIKE_MIN):
            return "does not exist (did you mean embedded?)"
        return f"does not exist; make one with `readygo scene import FILE --out {folder}`"
    if folder.suffix.lower() in _GAUSSIAN_ENDINGS:
        return f"is not a scene bundle; make one of it with `readygo scene import {folder} --out NEW`"
    for pattern, kind in _OTHER_FOLDERS.items():
        if any(folder.glob(pattern)):
            return f'is {kind}, not a scene; name a scene bundle, or "embedded"'
    return f"is not a scene bundle (no {MANIFEST}); make one with `readygo scene import FILE --out NEW`"


def _check(manifest: dict[str, Any], folder: Path) -> None:
    try:
        sizes = {name: entry["size"] for name, entry in manifest["files"].items()}
        intact = manifest["content_hash"] == combined_hash(manifest["content"])
    except (KeyError, TypeError, AttributeError) as error:
        raise SceneError(f"{folder / MANIFEST} is incomplete ({error!r}); import the scene again.") from error
    if not intact:
        raise SceneError(f"{folder / MANIFEST} was edited: its content_hash fits no longer; import the scene again.")
    for name, size in sizes.items():
        path = folder / name
        try:
            found = path.stat().st_size if path.is_file() else None
        except OSError:
            # No file can have this name.
            found = None
        if found != size:
            state = "is missing" if found is None else f"has {found} bytes instead of {size}"
            raise SceneError(f"Scene {folder} is damaged: {name} {state}; import the scene again.")
