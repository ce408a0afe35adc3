import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from readygo.common.avatars.importers.pickles import Record, array_of, load_pickle
from readygo.common.errors import AvatarError


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
        load_pickle(path)
    assert "\n" not in str(raised.value)
    assert not witness.exists()


@pytest.mark.parametrize("function", [eval, getattr, np.load, np.save])
def test_no_function_can_be_called(tmp_path: Path, function: Any) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(_Harmful(function, "1"), protocol=2))
    with pytest.raises(AvatarError, match="not loaded, because a pickle can run programs"):
        load_pickle(path)


@pytest.mark.parametrize("layout", ["csc", "csr", "coo"])
def test_sparse_matrices_become_the_arrays_they_stand_for(tmp_path: Path, layout: str) -> None:
    dense = np.array([[0.0, 2.0, 0.0], [5.0, 0.0, 0.0]])
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps({"J": sparse.coo_matrix(dense).asformat(layout), "n": "name"}, protocol=2))
    entries = load_pickle(path)
    np.testing.assert_array_equal(array_of(entries["J"]), dense)
    assert array_of(entries["n"]) is None


def test_selected_elements_of_an_array_are_read() -> None:
    source, chosen = Record(), Record()
    source.__setstate__({"x": np.array([[1.0, 2.0], [3.0, 4.0]])})
    chosen.name = "chumpy.reordering.Select"
    chosen.__setstate__({"a": source, "idxs": np.array([3, 0]), "preferred_shape": (1, 2)})
    np.testing.assert_array_equal(array_of(chosen), [[4.0, 1.0]])
    chosen.__setstate__({"a": source, "idxs": np.array([4])})
    assert array_of(chosen) is None


def test_objects_that_are_no_numbers_are_no_arrays() -> None:
    assert array_of(np.array([{}], dtype=object)) is None
