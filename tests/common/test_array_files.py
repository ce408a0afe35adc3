"""NumPy's files from elsewhere are read within their bounds, or refused in one line."""

import io
import os
import struct
import tracemalloc
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.array_files import NUMBERS, as_float64, load_npy, load_npz, map_npy
from readygo.common.errors import AvatarError

MB = 2**20
ROW = np.dtype([("time_ns", "<i8"), ("name", "S8"), ("pose", "<f8", (4,)), ("seen", "?")])


def _npy(descr: str, shape: str = "()", data: bytes = b"", *, fortran: str = "False") -> bytes:
    header = f"{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode("latin1") + data


def _zip(path: Path, *entries: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def _load(path: Path, *names: str, bytes_max: int = MB, **options: Any) -> dict[str, Any]:
    return load_npz(path, names or None, bytes_max=bytes_max, raises=AvatarError, **options)


def _refusal(path: Path, *names: str, **options: Any) -> str:
    with pytest.raises(AvatarError) as raised:
        _load(path, *names, **options)
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(path))
    return str(raised.value)


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_come_back_as_they_were_saved(tmp_path: Path, compressed: bool) -> None:
    rng = np.random.default_rng(0)
    arrays = {code[1:]: rng.integers(0, 2, (3, 5)).astype(code) for code in (*NUMBERS, ">f4")}
    arrays |= {"text": np.array("walk"), "none": np.array(""), "scalar": np.float32(1.5), "empty": np.zeros((0, 3))}
    arrays |= {"fortran": np.asfortranarray(rng.normal(size=(4, 6))), "big": rng.normal(size=300_000)}
    arrays["rows"] = np.zeros(3, ROW)
    (np.savez_compressed if compressed else np.savez)(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    read = _load(tmp_path / "a.npz", bytes_max=8 * MB, records=[ROW])
    assert list(read) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)
        assert (read[name].dtype, read[name].shape) == (array.dtype, array.shape)
        assert read[name].flags.writeable


def test_only_the_arrays_that_are_asked_for_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, betas=np.arange(3.0), huge=np.zeros(4 * MB), name=np.array([{}], dtype=object))
    tracemalloc.start()
    assert list(_load(path, "betas", "absent")) == ["betas"]
    assert tracemalloc.get_traced_memory()[1] < 4 * MB
    tracemalloc.stop()


def test_archive_that_unpacks_to_more_than_it_may_is_refused_before_that(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, betas=np.zeros(4 * MB))
    tracemalloc.start()
    assert "unpacks to 335" in _refusal(path, "betas", bytes_max=16 * MB)
    # The table of contents says little, the entry unpacks to much.
    data, size = bytearray(path.read_bytes()), struct.pack("<I", 32 * MB + 128)
    while (at := data.find(size)) >= 0:
        data[at : at + 4] = struct.pack("<I", 128 + 8)
    path.write_bytes(data)
    _refusal(path, "betas", bytes_max=16 * MB)
    assert tracemalloc.get_traced_memory()[1] < 4 * MB
    tracemalloc.stop()


@pytest.mark.parametrize(
    "descr", ["'m8[s/0]'", "'M8[s/0]'", "'|O'", "'<c8'", "'V4'", "'<U0'", "'f8,(2,)f4'", "[('a', 'm8[s/0]')]", "'" * 3]
)
@pytest.mark.parametrize("end", [b"", bytes(8)])
def test_other_dtypes_never_reach_numpy(tmp_path: Path, descr: str, end: bytes) -> None:
    """The first one ends a process that asks NumPy for it, with SIGFPE."""
    data = _npy(descr, "(1,)", end)
    _refusal(_zip(tmp_path / "a.npz", ("means.npy", data)), "means", records=[ROW])
    (tmp_path / "a.npy").write_bytes(data)
    for load in (lambda: load_npy(tmp_path / "a.npy", bytes_max=MB, raises=AvatarError),
                 lambda: map_npy(tmp_path / "a.npy", raises=AvatarError)):  # fmt: skip
        with pytest.raises(AvatarError, match=r"a\.npy is not a readable NumPy array"):
            load()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"text",
        b"\x93NUMPY\x01\x00",
        b"\x93NUMPY\x09\x00" + bytes(200),
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{",
        _npy("'<f8'", "(1000000000000,)"),
        _npy("'<f8'", "(2, 1)", bytes(8)),
        _npy("'<f8'", "(1,)", bytes(16)),
        _npy("'<f8'", "(0, 999999999999999999)"),
        _npy("'<f8'", "(-1,)", bytes(8)),
        _npy("'<f8'", "(1e0,)", bytes(8)),
        _npy("'<f8'", "(" + "1, " * 30 + ")", bytes(8)),
        _npy("'<f8'", "(" + "9" * 5000 + ",)", bytes(8)),
        _npy("'<f8'", "(" * 3000, bytes(8)),
        _npy("'<f8'", "(1,)", bytes(8), fortran="-" * 5000 + "1"),
        _npy("'<f8", "(1,)", bytes(8)),
    ],
)
def test_damaged_arrays_are_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    _refusal(_zip(tmp_path / "a.npz", ("betas.npy", data)), "betas")
    (tmp_path / "a.npy").write_bytes(data)
    with pytest.raises(AvatarError, match=r"a\.npy is not"):
        load_npy(tmp_path / "a.npy", bytes_max=MB, raises=AvatarError)


def test_damaged_archives_are_refused_in_one_line(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", betas=np.random.default_rng(0).normal(size=1000))
    data = (tmp_path / "a.npz").read_bytes()
    path = tmp_path / "b.npz"
    for damaged in (b"", b"PK\x03\x04", data[: len(data) // 2], data[:100] + b"\xff" * 64 + data[164:]):
        path.write_bytes(damaged)
        assert "not a readable NumPy archive" in _refusal(path)
    rng = np.random.default_rng(1)
    for _ in range(300):
        mutated = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            mutated[at] = rng.integers(256)
        path.write_bytes(mutated)
        with suppress(AvatarError):
            _load(path, "betas")


def test_methods_of_compression_that_numpy_does_not_use_are_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(10))
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        path = _zip(tmp_path / "a.npz", ("betas.npy", buffer.getvalue()), method=method)
        assert "which NumPy does not use" in _refusal(path)


def test_table_of_contents_of_a_million_files_costs_nothing(tmp_path: Path) -> None:
    entry = struct.pack("<4s6H3I5H2I", b"PK\x01\x02", 20, 20, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    path, count = tmp_path / "a.npz", 100_000
    end = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, 0, 0, len(entry) * count, 0, 0)
    path.write_bytes(entry * count + end)
    tracemalloc.start()
    assert "table of contents" in _refusal(path, "betas")
    assert tracemalloc.get_traced_memory()[1] < MB
    tracemalloc.stop()


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    assert "a pipe or a device" in _refusal(tmp_path / "pipe.npz")
    assert "No such file" in _refusal(tmp_path / "absent.npz")
    assert "Is a directory" in _refusal(tmp_path)
    assert _refusal(tmp_path / "a\0.npz").endswith("no file can have this name.")
    assert _refusal(tmp_path / "absent.npz", remedy="give another").endswith("; give another.")


def test_single_array_is_read_up_to_a_size_and_mapped(tmp_path: Path) -> None:
    path, array = tmp_path / "a.npy", np.arange(24.0).reshape(2, 3, 4)
    np.save(path, array)
    np.testing.assert_array_equal(load_npy(path, bytes_max=MB, raises=AvatarError), array)
    with pytest.raises(AvatarError, match="it has 320 bytes, 319 are read at most"):
        load_npy(path, bytes_max=319, raises=AvatarError)
    mapped = map_npy(path, raises=AvatarError)
    np.testing.assert_array_equal(mapped, array)
    assert not mapped.flags.writeable


def test_arrays_of_numbers_become_float64_and_others_are_refused() -> None:
    for array in (np.array([True]), np.array([1], np.uint8), np.array([1.0], ">f4")):
        numbers = as_float64(array, "x", raises=AvatarError)
        assert (numbers.dtype, numbers.tolist()) == (np.float64, [1.0])
    for array in (np.array(["1"]), np.zeros(1, ROW)):
        with pytest.raises(AvatarError, match="x must hold numbers, got values of"):
            as_float64(array, "x", raises=AvatarError)


def test_text_of_characters_that_do_not_exist_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, meta=np.array("{}"), none=np.array([], "<U3"))
    assert str(load_npz(path, ["meta"], bytes_max=MB, raises=AvatarError)["meta"]) == "{}"
    content = path.read_bytes()
    buffer = io.BytesIO()
    np.save(buffer, np.array("{}"))
    wrong = buffer.getvalue()[:-4] + (0x110000).to_bytes(4, "little")
    assert content
    assert "characters that do not exist" in _refusal(_zip(path, ("meta.npy", wrong)), "meta")
