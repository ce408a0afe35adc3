"""NumPy's files, .npy and .npz, that others have written: all that they claim is checked before it costs anything.

NumPy is given the names of a few dtypes only: that of a time of 0 seconds ends the process. Nothing is unpickled. A
file is read up to a size that its reader names, also where a few bytes claim, or unfold to, a thousand million.

Source: NumPy enhancement proposal 1, https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html.
"""

import math
import os
import re
import sys
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array
from readygo.common.errors import ReadygoError
from readygo.common.files import open_regular, open_zip

NUMBERS = ("|b1", "|u1", "|i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
"""Dtypes that arrays from elsewhere may have, besides texts and big-endian numbers in files."""
_DTYPES = {code: np.dtype(code) for code in (*NUMBERS, *(code.replace("<", ">") for code in NUMBERS if code[0] == "<"))}
_TEXT = re.compile(r"[<|][US][0-9]{1,5}")
_MAGIC = b"\x93NUMPY"
_HEADER_BYTES_MAX = 10_000
_HEADER = re.compile(
    r"\{\s*'descr':\s*(?P<descr>'[^']{1,40}'|\[[^\[\]]*\]),\s*'fortran_order':\s*(?P<fortran>True|False),"
    r"\s*'shape':\s*\((?P<shape>[0-9L, ]*)\)\s*,?\s*\}\s*"
)
_LENGTH = re.compile(r"([0-9]{1,18})L?")
_DIMENSIONS_MAX = 8
_BLOCK_BYTES = 2**20


class _Layout(NamedTuple):
    """What the header of an array says."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    order: Any
    """"C" or "F"."""
    begin: int
    """Bytes before the numbers."""


def dtype_of(code: str) -> np.dtype[Any] | None:
    """The dtype of numbers with this name, None of any other."""
    return _DTYPES.get(code)


def load_npz(
    path: Path,
    names: Collection[str] | None,
    *,
    bytes_max: int,
    raises: type[ReadygoError],
    records: Collection[np.dtype[Any]] = (),
    remedy: str = "",
) -> dict[str, AnyArray]:
    """Arrays of an archive; nothing else in it is looked at.

    Args:
        path: The archive.
        names: Names of the arrays; those that are missing are left out. None stands for all.
        bytes_max: The arrays may have so many bytes together, unpacked.
        raises: What is raised.
        records: Dtypes of records that arrays may have.
        remedy: What the user can do, for the error.

    Raises:
        ReadygoError: If the file cannot be read, is damaged, has more bytes, or an array of another dtype.
    """
    with _damage_in_one_line(path, "a readable NumPy archive (.npz)", raises, remedy), open_zip(path) as archive:
        infos = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        wanted = {name: infos[name] for name in (infos if names is None else names) if name in infos}
        unpacked = sum(info.file_size for info in wanted.values())
        if unpacked > bytes_max:
            raise ValueError(f"it unpacks to {unpacked} bytes, {bytes_max} are read at most")
        return {name: _read_entry(archive, name, info, records) for name, info in wanted.items()}


def load_npy(path: Path, *, bytes_max: int, raises: type[ReadygoError], remedy: str = "") -> AnyArray:
    """The array of numbers in a file; arguments as of `load_npz`.

    Raises:
        ReadygoError: If the file cannot be read, is damaged, larger than `bytes_max`, or of another dtype.
    """
    with _damage_in_one_line(path, "a readable NumPy array (.npy)", raises, remedy), open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > bytes_max:
            raise ValueError(f"it has {size} bytes, {bytes_max} are read at most")
        return _read_array(stream, size, ())


def as_float64(array: AnyArray, name: str, *, raises: type[ReadygoError]) -> Float64Array:
    """An array that was read, as float64.

    Raises:
        ReadygoError: If it holds no numbers; `name` says in the message what it is.
    """
    if array.dtype.kind not in "biuf":
        raise raises(f"{name} must hold numbers, got values of {array.dtype}.")
    return array.astype(np.float64)


def map_npy(path: Path, *, raises: type[ReadygoError]) -> AnyArray:
    """The array of numbers in a file, mapped read-only.

    Raises:
        ReadygoError: If the file cannot be mapped, is damaged, or of another dtype.
    """
    with _damage_in_one_line(path, "a readable NumPy array (.npy)", raises), open_regular(path) as stream:
        layout = _read_layout(stream, os.fstat(stream.fileno()).st_size, ())
        return np.memmap(stream, layout.dtype, "r", layout.begin, layout.shape, layout.order)


@contextmanager
def _damage_in_one_line(path: Path, what: str, raises: type[ReadygoError], remedy: str = "") -> Iterator[None]:
    end = f"; {remedy}." if remedy else "."
    try:
        yield
    except OSError as error:
        raise raises(f"{path} cannot be read: {error.strerror or error}{end}") from error
    except Exception as error:  # a damaged archive raises almost anything
        line = " ".join(str(error).split())[:300] or type(error).__name__
        raise raises(f"{path} is not {what}: {line.removesuffix('.')}{end}") from error


def _read_entry(
    archive: zipfile.ZipFile, name: str, info: zipfile.ZipInfo, records: Collection[np.dtype[Any]]
) -> AnyArray:
    # What the other methods need in memory is for the archive to say.
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is compressed by method {info.compress_type}, which NumPy does not use")
    try:
        with archive.open(info) as stream:
            return _read_array(stream, info.file_size, records)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _read_array(stream: IO[bytes], size: int, records: Collection[np.dtype[Any]]) -> AnyArray:
    """The array in a stream of `size` bytes."""
    layout = _read_layout(stream, size, records)
    array: AnyArray = np.empty(math.prod(layout.shape), layout.dtype)
    raw, at = array.view(np.uint8), 0
    while at < len(raw):
        block = stream.read(min(_BLOCK_BYTES, len(raw) - at))
        if not block:
            raise EOFError("it is truncated")
        raw[at : at + len(block)] = np.frombuffer(block, np.uint8)
        at += len(block)
    if layout.dtype.kind == "U" and array.view("<u4").max(initial=0) > sys.maxunicode:
        raise ValueError("it holds text of characters that do not exist")
    return array.reshape(layout.shape, order=layout.order)


def _read_layout(stream: IO[bytes], size: int, records: Collection[np.dtype[Any]]) -> _Layout:
    """The header of an array that has, with it, `size` bytes."""
    start = stream.read(len(_MAGIC) + 2)
    if start[:-2] != _MAGIC or start[-2] not in (1, 2, 3):
        raise ValueError("it holds something else than an array")
    length_bytes = 2 if start[-2] == 1 else 4
    length = int.from_bytes(stream.read(length_bytes), "little")
    text = stream.read(min(length, _HEADER_BYTES_MAX)).decode("latin1")
    found = _HEADER.fullmatch(text)
    if found is None:
        raise ValueError(f"an array cannot begin with {text[:100]!r}")
    dtype, shape = _dtype(found["descr"], records), _shape(found["shape"])
    begin = len(start) + length_bytes + length
    if begin + math.prod(shape) * dtype.itemsize != size or max(shape, default=0) > size:
        raise ValueError(f"an array of {dtype} {shape} does not have {size - begin} bytes")
    return _Layout(dtype, shape, "F" if found["fortran"] == "True" else "C", begin)


def _dtype(descr: str, records: Collection[np.dtype[Any]]) -> np.dtype[Any]:
    for record in records:
        if descr == repr(record.descr):
            return record
    code = descr[1:-1]
    if code not in _DTYPES and (not _TEXT.fullmatch(code) or int(code[2:]) == 0):
        what = "Python objects" if code.startswith("|O") else f"values of type {code[:100]!r}"
        raise ValueError(f"it holds {what}, which are not read")
    return _DTYPES[code] if code in _DTYPES else np.dtype(code)


def _shape(text: str) -> tuple[int, ...]:
    lengths = (
        [_LENGTH.fullmatch(part.strip()) for part in text.strip().removesuffix(",").split(",")] if text.strip() else []
    )
    if len(lengths) > _DIMENSIONS_MAX or None in lengths:
        raise ValueError(f"an array cannot have the shape ({text[:100]})")
    return tuple(int(length[1]) for length in lengths if length is not None)
