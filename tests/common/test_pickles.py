import os
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from readygo.common.errors import AvatarError
from readygo.common.pickles import PickledObject, array_of, load_pickle


def _load(path: Path) -> Any:
    return load_pickle(path, bytes_max=2**24, raises=AvatarError)


class _Harmful:
    def __init__(self, function: Any, *arguments: Any) -> None:
        self.reduced = function, arguments

    def __reduce__(self) -> Any:
        return self.reduced


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_pickles_that_name_anything_else_are_refused_by_name(tmp_path: Path, protocol: int) -> None:
    path, witness = tmp_path / "SMPL.pkl", tmp_path / "ran"
    entries = {"weights": np.ones(3), "extra": _Harmful(os.system, f"touch {witness}")}
    path.write_bytes(pickle.dumps(entries, protocol=protocol))
    with pytest.raises(AvatarError, match=r"posix\.system") as raised:
        _load(path)
    assert "\n" not in str(raised.value)
    assert not witness.exists()


@pytest.mark.parametrize("function", [eval, getattr, np.load, np.save])
def test_no_function_can_be_called(tmp_path: Path, function: Any) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(_Harmful(function, "1"), protocol=2))
    with pytest.raises(AvatarError, match="not loaded, because a pickle can run programs"):
        _load(path)


@pytest.mark.parametrize("layout", ["csc", "csr", "coo"])
def test_sparse_matrices_become_the_arrays_they_stand_for(tmp_path: Path, layout: str) -> None:
    dense = np.array([[0.0, 2.0, 0.0], [5.0, 0.0, 0.0]])
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps({"J": sparse.coo_matrix(dense).asformat(layout), "n": "name"}, protocol=2))
    entries = _load(path)
    np.testing.assert_array_equal(array_of(entries["J"]), dense)
    assert array_of(entries["n"]) is None


def test_selected_elements_of_an_array_are_read() -> None:
    source, chosen = PickledObject(), PickledObject()
    source.__setstate__({"x": np.array([[1.0, 2.0], [3.0, 4.0]])})
    chosen.name = "chumpy.reordering.Select"
    chosen.__setstate__({"a": source, "idxs": np.array([3, 0]), "preferred_shape": (1, 2)})
    np.testing.assert_array_equal(array_of(chosen), [[4.0, 1.0]])
    chosen.__setstate__({"a": source, "idxs": np.array([4])})
    assert array_of(chosen) is None


def test_objects_that_are_no_numbers_are_no_arrays() -> None:
    assert array_of(np.array([{}], dtype=object)) is None


def _dtype(code: str) -> bytes:
    return b"cnumpy\ndtype\n(U" + bytes([len(code)]) + code.encode() + b"I0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntb"


def _array(dtype: bytes, shape: bytes, raw: bytes) -> bytes:
    start = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR(I1\n"
    return start + shape + dtype + b"I00\nT" + len(raw).to_bytes(4, "little") + raw + b"tb."


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4])
def test_arrays_and_numbers_come_back_as_they_were_pickled(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "x.pkl"
    arrays = [np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6).reshape(2, 3)), np.zeros((0, 3), np.uint8)]
    arrays += [np.array([1.5], ">f4"), np.array([True, False]), np.array(7, np.uint32)]
    path.write_bytes(pickle.dumps([*arrays, np.float64(0.25)], protocol=protocol))
    *read, number = _load(path)
    for want, have in zip(arrays, map(array_of, read), strict=True):
        assert have is not None
        np.testing.assert_array_equal(have, want)
        assert have.dtype == want.dtype
    assert number == 0.25


@pytest.mark.parametrize("code", ["m8[s/0]", "M8[s/0]", "O8", "V4", "c8", "i3", "(2,)f8"])
def test_other_dtypes_never_reach_numpy(tmp_path: Path, code: str) -> None:
    """The first one ends a process that asks NumPy for it, with SIGFPE."""
    path = tmp_path / "x.pkl"
    path.write_bytes(_array(_dtype(code), b"(I1\nt", bytes(8)))
    assert array_of(_load(path)) is None
    path.write_bytes(b"cnumpy.core.multiarray\nscalar\n(" + _dtype(code) + b"S'12345678'\ntR.")
    with pytest.raises(AvatarError):
        _load(path)


@pytest.mark.parametrize("shape", [b"(I2\nt", b"(I1000000000000\nt", b"(I-1\nt", b"N", b"(Nt", b"(I0\nt", b"(F1.0\nt"])
def test_array_of_other_bytes_than_its_shape_says_is_refused(tmp_path: Path, shape: bytes) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(_array(_dtype("f8"), shape, bytes(8)))
    with pytest.raises(AvatarError, match="is not a readable pickle: an array"):
        _load(path)


_TEXT = b"X\x00\x00\x10\x00" + b"a" * 2**20 + b"q\x00"
_ENCODED = b"c_codecs\nencode\n(h\x00X\x06\x00\x00\x00latin1tR"


@pytest.mark.parametrize(
    "data",
    [
        b"Nr\xff\xff\xff\x0f.",
        b"Np999999999\n.",
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0fabc.",
        b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x0f.",
        b"T\xff\xff\xff\x7f.",
        b"(" + b"N" * 2_000_000 + b"l.",
        b"(" + _TEXT + _ENCODED * 1000 + b"l.",
        b"(" + _TEXT + b"c__builtin__\nlist\n(h\x00tR" * 1000 + b"l.",
        b"(" + b"".join(b"cchumpy.a%d\nCh\n" % number for number in range(1000)) + b"l.",
        b"c_codecs\nencode\nN}S'a'\nI1\ns\x86b.",
        b"cnumpy\nndarray\n}S'values'\nI1\nsb.",
        b"c__builtin__\nobject\nN}S'a'\nI1\ns\x86b.",
        b"\x82\x01.",
        b"Pabc\n.",
    ],
)
def test_programs_that_cost_more_than_they_are_end_in_one_line(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(data)
    tracemalloc.start()
    with pytest.raises(AvatarError) as raised:
        _load(path)
    assert tracemalloc.get_traced_memory()[1] < 64e6
    tracemalloc.stop()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("data", [b"cnumpy\nndarray\n(I1000000000\ntR.", b"(" * 100_000 + b"t" * 100_000 + b"."])
def test_programs_that_make_nothing_of_use_make_no_array(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(data)
    assert array_of(_load(path)) is None


def test_records_that_hold_themselves_or_claim_huge_matrices_are_no_arrays() -> None:
    loop, matrix = PickledObject(), PickledObject()
    loop.__setstate__({"x": loop})
    assert array_of(loop) is None
    loop.name = "chumpy.reordering.Select"
    loop.__setstate__({"a": loop, "idxs": loop})
    assert array_of(loop) is None
    matrix.name = "scipy.sparse.csc_matrix"
    parts = {"data": np.zeros(0), "indices": np.zeros(0, np.int32), "indptr": np.zeros(2, np.int32)}
    for shape in ((10**12, 1), (-1, -1), "shape", None, (1, loop)):
        matrix.__setstate__(parts | {"shape": shape})
        assert array_of(matrix) is None


def test_larger_files_and_such_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(bytes(1000)))
    with pytest.raises(AvatarError, match="a pickle of 1 to 1000 bytes can be read; give another"):
        load_pickle(path, bytes_max=1000, raises=AvatarError, remedy="give another")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(AvatarError, match="a pipe or a device"):
        _load(tmp_path / "pipe")
