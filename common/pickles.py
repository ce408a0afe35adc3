"""Reading pickles of NumPy arrays that strangers made: nothing in them can run, and what they cost is bounded.

A pickle is a program that may call any function that it names. The unpickler here resolves a closed list of names, all
of them to functions and records of this module: what NumPy arrays are made of, SciPy's sparse matrices and chumpy's
arrays (which old SMPL files hold; chumpy itself does not run on today's Python). Any other name ends the reading. NumPy
makes no array before its dtype and its bytes were compared.
"""

import math
import mmap
import os
import pickle
import pickletools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import dtype_of
from readygo.common.arrays import AnyArray
from readygo.common.errors import ReadygoError
from readygo.common.files import open_regular

_OPCODES_MAX = 500_000
"""Steps of the program; those of SMPL models have some thousands."""
_UNKNOWN_OPCODES = frozenset({"EXT1", "EXT2", "EXT4", "PERSID", "BINPERSID", "NEXT_BUFFER", "READONLY_BUFFER"})
_PUTS = frozenset({"PUT", "BINPUT", "LONG_BINPUT"})
_DENSE_NUMBERS_MAX = 2**24
"""Numbers of a matrix that is stored sparse."""
_NESTED_MAX = 4
_KINDS_MAX = 100
"""Classes of SciPy and chumpy that a pickle names."""
_SPARSE_LAYOUTS = ("csc", "csr", "coo")


class PickledObject:
    """What a pickle said about an object whose class is not loaded."""

    name = ""
    fields: Mapping[str, Any] = {}

    def __init__(self, *_: Any) -> None:
        self.fields = {}

    def __setstate__(self, state: Any) -> None:
        parts = state if isinstance(state, tuple) else (state,)
        self.fields = {key: value for part in parts if isinstance(part, dict) for key, value in part.items()}


class _Dtype(PickledObject):
    """A dtype by its name, which NumPy has not heard of yet."""

    code = order = ""

    def __init__(self, code: Any = "", *_: Any) -> None:
        self.code = str(code)[:4]

    def __setstate__(self, state: Any) -> None:
        self.order = str(state[1])[:1]

    @property
    def dtype(self) -> np.dtype[Any] | None:
        """NumPy's, None if it is of no plain numbers."""
        return dtype_of((self.order or "<") + self.code) or dtype_of("|" + self.code)


class _Array(PickledObject):
    """An array as NumPy pickles it."""

    values: AnyArray | None = None
    """The array; None if it holds no plain numbers."""

    def __setstate__(self, state: Any) -> None:
        shape, dtype, fortran, raw = state[-4:]
        if dtype.dtype is not None:
            # Pickles of Python 2 hold bytes as text.
            self.values = _numbers(shape, dtype.dtype, raw.encode("latin1") if isinstance(raw, str) else raw, fortran)


class _Function:
    """What a pickle may call, and nothing else of it."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)

    def __setstate__(self, _: Any) -> None:
        raise ValueError("it changes what it calls")


class _RefusedError(Exception):
    """Why a pickle is not read."""


def load_pickle(path: Path, *, bytes_max: int, raises: type[ReadygoError], remedy: str = "") -> Any:
    """The object that a pickle holds, made of builtin types, NumPy's numbers and `PickledObject`s; see `array_of`.

    Args:
        path: A pickle of Python 2 or 3; byte strings of Python 2 are read as latin-1.
        bytes_max: A larger file is refused [bytes].
        raises: What is raised.
        remedy: What the user can do, for the error.

    Raises:
        ReadygoError: If the file is no pickle, costs too much, or names anything that is not known to be harmless.
    """
    end = f"; {remedy}." if remedy else "."
    try:
        with open_regular(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            if not 0 < size <= bytes_max:
                raise _RefusedError(f"has {size} bytes; a pickle of 1 to {bytes_max} bytes can be read")
            with mmap.mmap(stream.fileno(), size, access=mmap.ACCESS_READ) as data:
                _check_opcodes(data)
                data.seek(0)
                return _Unpickler(data, size).load()
    except _RefusedError as error:
        raise raises(f"{path} {error}{end}") from None
    except OSError as error:
        raise raises(f"{path} cannot be read: {error.strerror or error}{end}") from error
    except Exception as error:  # a broken pickle raises almost anything
        line = " ".join(str(error).split())[:300] or type(error).__name__
        raise raises(f"{path} is not a readable pickle: {line.removesuffix('.')}{end}") from error


def array_of(value: Any, *, nested: int = _NESTED_MAX) -> AnyArray | None:
    """The numbers of an array, of a chumpy array or of a sparse matrix; None if `value` is none of them.

    Args:
        value: A part of what `load_pickle` gives.
        nested: Records in which the array may be wrapped.
    """
    if isinstance(value, np.ndarray):
        return None if value.dtype.kind == "O" else value
    if isinstance(value, _Array):
        return value.values
    if not isinstance(value, PickledObject) or nested == 0:
        return None
    if value.name.startswith("scipy."):
        return _dense(value)
    if value.name.endswith(".Select"):
        return _select_elements(value.fields, nested - 1)
    return array_of(value.fields.get("x"), nested=nested - 1)


def _check_opcodes(data: Any) -> None:
    """Raise unless every opcode has its bytes, and none asks for memory that the others have not filled."""
    for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
        if count == _OPCODES_MAX:
            raise _RefusedError(f"is a program of more than {_OPCODES_MAX} steps, which no model file is")
        if opcode.name in _UNKNOWN_OPCODES:
            raise _RefusedError(f"asks for {opcode.name}, which model files have no use for")
        if opcode.name in _PUTS and (argument or 0) > _OPCODES_MAX:
            raise _RefusedError(f"keeps an object under the number {argument}")


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: mmap.mmap, size: int) -> None:
        super().__init__(data, encoding="latin1")
        self._left = size
        """Bytes that calls may still copy: as many as the file has."""
        self._kinds: dict[str, type[PickledObject]] = {}

    def find_class(self, module_name: str, global_name: str) -> Any:
        name = f"{module_name}.{global_name}"
        if name in _KNOWN:
            return _KNOWN[name]
        if name == "_codecs.encode":
            return _Function(self._latin1)
        if module_name in ("__builtin__", "builtins", "collections") and global_name in _CONTAINERS:
            return _Function(lambda *arguments: _CONTAINERS[global_name](*map(self._charge, arguments)))
        sparse = any(global_name == f"{layout}_{kind}" for layout in _SPARSE_LAYOUTS for kind in ("matrix", "array"))
        if (module_name.startswith("scipy.sparse") and sparse) or module_name.split(".")[0] == "chumpy":
            if name not in self._kinds and len(self._kinds) < _KINDS_MAX:
                self._kinds[name] = type("Record", (PickledObject,), {"name": name})
            return self._kinds[name]
        raise _RefusedError(
            f"names {' '.join(name.split())[:100]}, which model files have no use for; it is not loaded, because a "
            "pickle can run programs"
        )

    def _latin1(self, text: str, encoding: str = "latin1") -> bytes:
        """How Python 3 writes bytes into pickles of protocol 2."""
        if encoding not in ("latin1", "latin-1"):
            raise _RefusedError(f"asks for the codec {encoding!r}; only latin1 is read")
        return str(self._charge(text)).encode("latin1")

    def _charge(self, argument: Any) -> Any:
        """An argument that a call copies. One that is named again and again would cost more than the file has."""
        self._left -= len(argument)
        if self._left < 0:
            raise _RefusedError("copies the same bytes again and again")
        return argument


def _numbers(shape: Any, dtype: np.dtype[Any], raw: Any, fortran: Any) -> AnyArray:
    """An array of as many bytes as its shape says."""
    if not isinstance(shape, tuple) or not all(type(length) is int and length >= 0 for length in shape):
        raise ValueError(f"an array cannot have the shape {str(shape)[:100]}")
    if not isinstance(raw, bytes) or math.prod(shape) * dtype.itemsize != len(raw):
        raise ValueError(f"an array of {dtype} {shape} has other bytes")
    return np.frombuffer(raw, dtype).reshape(shape, order="F" if fortran else "C")


def _new_array(*_: Any) -> _Array:
    """What NumPy's `_reconstruct` does: an empty array, which `_Array.__setstate__` fills."""
    return _Array()


def _scalar(dtype: Any, raw: Any) -> Any:
    """What NumPy's `scalar` does for plain numbers."""
    if dtype.dtype is None:
        raise ValueError("it holds a value of a type that is not read")
    return _numbers((1,), dtype.dtype, raw.encode("latin1") if isinstance(raw, str) else raw, False)[0]


def _new_record(kind: Any, *_: Any) -> Any:
    """What `copyreg._reconstructor` does for a plain object."""
    if not (isinstance(kind, type) and issubclass(kind, PickledObject)):
        raise _RefusedError("makes an object of an unknown class")
    return kind()


_CONTAINERS: Mapping[str, Callable[..., Any]] = {
    **{kind.__name__: kind for kind in (set, frozenset, list, dict, tuple)},
    "OrderedDict": dict,
}
_KNOWN: Mapping[str, Any] = {
    **{f"numpy.{core}.multiarray._reconstruct": _Function(_new_array) for core in ("core", "_core")},
    **{f"numpy.{core}.multiarray.scalar": _Function(_scalar) for core in ("core", "_core")},
    "numpy.ndarray": _Array,
    "numpy.dtype": _Dtype,
    **{f"{module}._reconstructor": _Function(_new_record) for module in ("copy_reg", "copyreg")},
    **{f"{module}.object": object for module in ("__builtin__", "builtins")},
    # Python 3 writes empty bytes into pickles of protocol 2 as a call without arguments.
    **{f"{module}.bytes": _Function(lambda: b"") for module in ("__builtin__", "builtins")},
}


def _dense(record: PickledObject) -> AnyArray | None:
    from scipy import sparse

    layout = record.name.rsplit(".", 1)[1][:3]
    fields: dict[str, Any] = {
        key: value.values if isinstance(value, _Array) else value for key, value in record.fields.items()
    }
    shape: Any = fields.get("_shape", fields.get("shape"))
    try:
        rows_count, columns_count = shape
        if not 0 < int(rows_count) * int(columns_count) <= _DENSE_NUMBERS_MAX:
            return None
        if layout == "coo":
            at = fields["coords"] if "coords" in fields else (fields["row"], fields["col"])
            rows, columns = (array_of(indices) for indices in at)
            matrix = sparse.coo_matrix((fields["data"], (rows, columns)), shape=shape)
        else:
            kind = sparse.csc_matrix if layout == "csc" else sparse.csr_matrix
            matrix = kind((fields["data"], fields["indices"], fields["indptr"]), shape=shape)
            matrix.check_format(full_check=True)
        dense: AnyArray = matrix.toarray()
    except Exception:  # SciPy raises almost anything at parts that make no matrix
        return None
    return dense


def _select_elements(fields: Mapping[str, Any], nested: int) -> AnyArray | None:
    """`chumpy.reordering.Select`: elements of another array, by their flat indices."""
    source, index = array_of(fields.get("a"), nested=nested), array_of(fields.get("idxs"), nested=nested)
    if source is None or index is None or index.dtype.kind not in "iu":
        return None
    try:
        selected: AnyArray = source.reshape(-1)[index].reshape(fields.get("preferred_shape", (-1,)))
    except (IndexError, TypeError, ValueError, OverflowError, MemoryError):
        return None
    return selected
