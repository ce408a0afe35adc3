"""Reading pickles of NumPy arrays that strangers made: nothing in them can run.

A pickle is a program that may call whatever it names. The unpickler here resolves a closed list of names: what NumPy
arrays are made of, and inert records in place of SciPy's sparse matrices and of chumpy's arrays (which old SMPL files
hold; chumpy itself does not run on today's Python). Any other name ends the reading.
"""

import pickle
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.errors import AvatarError

_RECONSTRUCT: Callable[..., Any] = np.empty(0).__reduce__()[0]  # type: ignore[assignment]
_SCALAR: Callable[..., Any] = np.float64(0.0).__reduce__()[0]  # type: ignore[assignment]
_SPARSE_LAYOUTS = ("csc", "csr", "coo")


class Record:
    """What a pickle said about an object whose class is not loaded."""

    name = ""
    fields: Mapping[str, Any] = {}

    def __init__(self, *_: Any) -> None:
        self.fields = {}

    def __setstate__(self, state: Any) -> None:
        parts = state if isinstance(state, tuple) else (state,)
        self.fields = {key: value for part in parts if isinstance(part, dict) for key, value in part.items()}


def load_pickle(path: Path) -> Any:
    """The object that a pickle holds, made of builtin types, NumPy arrays and `Record`s.

    Args:
        path: A pickle of Python 2 or 3; byte strings of Python 2 are read as latin-1.

    Raises:
        AvatarError: If the file is no pickle, or names anything that is not known to be harmless.
    """
    with path.open("rb") as stream:
        try:
            return _Unpickler(stream, encoding="latin1").load()
        except AvatarError as error:
            raise AvatarError(f"{path} {error}") from None
        except Exception as error:  # a broken pickle raises almost anything
            line = " ".join(str(error).split()) or type(error).__name__
            raise AvatarError(f"{path} is not a readable pickle: {line}.") from error


def array_of(value: Any) -> npt.NDArray[Any] | None:
    """The numbers of an array, of a chumpy array or of a sparse matrix; None if `value` is none of them."""
    if isinstance(value, np.ndarray):
        return None if value.dtype.kind == "O" else value
    if not isinstance(value, Record):
        return None
    if value.name.startswith("scipy."):
        return _dense(value)
    if value.name.endswith(".Select"):
        return _selected(value.fields)
    return array_of(value.fields.get("x"))


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str) -> Any:
        name = f"{module_name}.{global_name}"
        if name in _KNOWN:
            return _KNOWN[name]
        sparse = any(global_name == f"{layout}_{kind}" for layout in _SPARSE_LAYOUTS for kind in ("matrix", "array"))
        if (module_name.startswith("scipy.sparse") and sparse) or module_name.split(".")[0] == "chumpy":
            return type("Record", (Record,), {"name": name})
        raise AvatarError(
            f"names {name}, which model files have no use for; it is not loaded, because a pickle can run programs."
        )


def _latin1(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes into pickles of protocol 2."""
    if encoding not in ("latin1", "latin-1"):
        raise AvatarError(f"asks for the codec {encoding!r}; only latin1 is read.")
    return text.encode("latin1")


def _new_record(kind: Any, *_: Any) -> Any:
    """What `copyreg._reconstructor` does for a plain object."""
    if not (isinstance(kind, type) and issubclass(kind, Record)):
        raise AvatarError("makes an object of an unknown class.")
    return kind()


_KNOWN: Mapping[str, Any] = {
    **{f"numpy.{core}.multiarray._reconstruct": _RECONSTRUCT for core in ("core", "_core")},
    **{f"numpy.{core}.multiarray.scalar": _SCALAR for core in ("core", "_core")},
    "numpy.ndarray": np.ndarray,
    "numpy.dtype": np.dtype,
    "_codecs.encode": _latin1,
    **{f"{module}._reconstructor": _new_record for module in ("copy_reg", "copyreg")},
    **{
        f"{module}.{kind.__name__}": kind
        for module in ("__builtin__", "builtins")
        for kind in (object, set, frozenset, list, dict, tuple)
    },
    "collections.OrderedDict": dict,
}


def _dense(record: Record) -> npt.NDArray[Any] | None:
    from scipy import sparse

    layout = record.name.rsplit(".", 1)[1][:3]
    fields = record.fields
    shape = fields.get("_shape", fields.get("shape"))
    try:
        if layout == "coo":
            rows, columns = fields["coords"] if "coords" in fields else (fields["row"], fields["col"])
            matrix = sparse.coo_matrix((fields["data"], (rows, columns)), shape=shape)
        else:
            kind = sparse.csc_matrix if layout == "csc" else sparse.csr_matrix
            matrix = kind((fields["data"], fields["indices"], fields["indptr"]), shape=shape)
            matrix.check_format(full_check=True)
    except (KeyError, TypeError, ValueError):
        return None
    dense: npt.NDArray[Any] = matrix.toarray()
    return dense


def _selected(fields: Mapping[str, Any]) -> npt.NDArray[Any] | None:
    """`chumpy.reordering.Select`: elements of another array, by their flat indices."""
    source, index = array_of(fields.get("a")), array_of(fields.get("idxs"))
    if source is None or index is None or index.dtype.kind not in "iu":
        return None
    try:
        selected: npt.NDArray[Any] = source.reshape(-1)[index].reshape(fields.get("preferred_shape", (-1,)))
    except (IndexError, TypeError, ValueError):
        return None
    return selected
