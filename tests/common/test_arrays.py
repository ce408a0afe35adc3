"""Tests of the types of arrays."""

import re
import typing
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from readygo.common import arrays


@pytest.mark.parametrize(
    ("name", "dtype"),
    [
        ("Float64Array", np.float64),
        ("Float32Array", np.float32),
        ("FloatingArray", np.floating),
        ("BoolArray", np.bool_),
        ("UInt8Array", np.uint8),
        ("UInt16Array", np.uint16),
        ("UInt32Array", np.uint32),
        ("UInt64Array", np.uint64),
        ("Int16Array", np.int16),
        ("Int32Array", np.int32),
        ("Int64Array", np.int64),
        ("RecordArray", np.void),
        ("AnyArray", typing.Any),
    ],
)
def test_a_name_says_the_dtype(name: str, dtype: object) -> None:
    alias = getattr(arrays, name)
    assert typing.get_origin(alias) in (np.ndarray, npt.NDArray)
    # From numpy 2.5 on the alias names the dtype's scalar alone.
    assert dtype in (typing.get_args(alias)[-1], *typing.get_args(typing.get_args(alias)[-1]))


def test_no_module_has_types_of_arrays_of_its_own() -> None:
    root = Path(__file__).parents[2]
    alias = re.compile(r"^(?:type )?\w+(?:: TypeAlias)? = npt\.NDArray\[(?:np\.\w+|Any)\]$", re.MULTILINE)
    folders = ("common", "services", "runs", "apps", "benchmarks", "experiments", "tests")
    with_alias = [
        str(path.relative_to(root))
        for folder in folders
        for path in (root / folder).rglob("*.py")
        if alias.search(path.read_text(encoding="utf-8"))
    ]
    assert with_alias == ["common/arrays.py"]
