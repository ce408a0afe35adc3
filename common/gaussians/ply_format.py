"""The PLY container: header and fixed-size binary elements."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.errors import SceneError
from readygo.common.files import open_regular

_DTYPES = {
    "char": "<i1",
    "int8": "<i1",
    "uchar": "<u1",
    "uint8": "<u1",
    "short": "<i2",
    "int16": "<i2",
    "ushort": "<u2",
    "uint16": "<u2",
    "int": "<i4",
    "int32": "<i4",
    "uint": "<u4",
    "uint32": "<u4",
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
}
_HEADER_LINE_LIMIT = 1000
_LINE_BYTES_LIMIT = 4096


@dataclass(frozen=True)
class PlyElement:
    """One element of a header: its name, row count and row layout."""

    name: str
    count: int
    dtype: np.dtype[Any]


def read_ply(path: Path) -> dict[str, AnyArray]:
    """Read every element of a binary little-endian PLY file.

    Args:
        path: File.

    Returns:
        One structured array per element, in file order.

    Raises:
        SceneError: If the file is missing, is no PLY, is text or big-endian, has list properties or is truncated.
    """
    try:
        with open_regular(path) as file:
            elements = _read_header(file, path)
            _check_size(file, path, elements)
            return {element.name: np.fromfile(file, element.dtype, element.count) for element in elements}
    except OSError as error:
        raise SceneError(f"{path} cannot be read: {error.strerror or error}.") from error


def _check_size(file: BinaryIO, path: Path, elements: list[PlyElement]) -> None:
    expected = file.tell() + sum(element.count * element.dtype.itemsize for element in elements)
    found = path.stat().st_size
    if found < expected:
        raise SceneError(f"{path} is truncated: {expected} bytes expected, {found} found; copy or export it again.")


def _read_header(file: BinaryIO, path: Path) -> list[PlyElement]:
    if file.readline(16).strip() != b"ply":
        raise SceneError(
            f"{path} is not a PLY file: it does not start with 'ply'; convert other formats first, for example with "
            "`splat-transform IN OUT.compressed.ply`."
        )
    elements: list[PlyElement] = []
    fields: list[tuple[str, str]] = []
    for _ in range(_HEADER_LINE_LIMIT):
        words = file.readline(_LINE_BYTES_LIMIT).decode("ascii", "replace").split()
        match words:
            case ["end_header"]:
                return [*elements[:-1], *_close_element(elements[-1:], fields, path)]
            case ["format", "binary_little_endian", "1.0"] | ["comment" | "obj_info", *_]:
                pass
            case ["format", *rest]:
                raise SceneError(f"{path} has PLY format {' '.join(rest)!r}; export it as binary_little_endian 1.0.")
            case ["element", name, count] if count.isdigit():
                elements = [*elements[:-1], *_close_element(elements[-1:], fields, path)]
                elements.append(PlyElement(name, int(count), np.dtype([])))
                fields = []
            case ["property", "list", *_]:
                raise SceneError(f"{path} is a mesh (list properties), not a Gaussian scene; export the Gaussians.")
            case ["property", kind, name] if kind in _DTYPES and elements:
                fields.append((name, _DTYPES[kind]))
            case _:
                raise SceneError(f"{path} has a broken PLY header at {' '.join(words)[:60]!r}; export it again.")
    raise SceneError(f"{path} has no 'end_header' in its first {_HEADER_LINE_LIMIT} lines; export it again.")


def _close_element(last: list[PlyElement], fields: list[tuple[str, str]], path: Path) -> list[PlyElement]:
    """The last element of a header with its row layout filled in."""
    names = [name for name, _ in fields]
    if not names and any(element.count for element in last):
        raise SceneError(f"{path} has an element {last[0].name!r} without properties; export it again.")
    if len(set(names)) != len(names):
        raise SceneError(f"{path} names a property twice; export it again.")
    return [PlyElement(element.name, element.count, np.dtype(fields)) for element in last]


def require_fields(table: AnyArray, names: list[str], path: Path, what: str) -> None:
    """Raise SceneError naming the first of `names` that a table lacks."""
    missing = [name for name in names if name not in (table.dtype.names or ())]
    if missing:
        raise SceneError(f"{path} lacks the property {missing[0]!r}: it is not {what}.")


def columns(table: AnyArray, names: list[str]) -> Float32Array:
    """Some properties side by side as float32, shape (N, len(names))."""
    out = np.empty((len(table), len(names)), np.float32)
    for i, name in enumerate(names):
        out[:, i] = table[name]
    return out
