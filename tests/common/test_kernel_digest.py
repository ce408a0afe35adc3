import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import llvmlite
import numba
import pytest

from readygo.common import kernel_digest as digests
from readygo.common.kernel_digest import kernel_digest, type_digest

KERNEL = """
import math
from readygo.common.kernels import inline_kernel, kernel_with_cache
from pieces import *

{before}

@inline_kernel
def inner(x{default}):
    return x * FACTOR + TABLE[0] + OFFSETS[1]

@inline_kernel
def outer(x, y=0):
    if x > Kind.WALL:
        return inner(Point(x, x).x)
    return inner(x)

@kernel_with_cache{flags}
def root(x):
    return outer(x) + math.sin(x)

{after}
"""
PIECES = """
import enum
from typing import NamedTuple
import numpy as np

FACTOR = {factor}
TABLE = np.array({table})
OFFSETS = (1.0, {offset})
UNUSED = {unused}

class Kind(enum.IntEnum):
    FLOOR = 0
    WALL = {wall}

class Point(NamedTuple):
    x: float
    y: float = {default_y}
"""
PARTS = {
    "factor": "2.0", "table": "[1.0, 2.0]", "offset": "2", "unused": "1", "wall": "1", "default_y": "0.0",
    "before": "", "after": "", "default": "", "flags": "",
}  # fmt: skip


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Callable[..., ModuleType]]:
    """Imports the kernels above as they are when some parts of them are edited."""

    def load(**edits: str) -> ModuleType:
        for name, source in (("pieces", PIECES), ("edited", KERNEL)):
            path = tmp_path / f"{name}.py"
            path.write_text(source.format(**PARTS | edits))
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None
            assert spec.loader is not None
            loaded = importlib.util.module_from_spec(spec)
            sys.modules[name] = loaded
            exec(compile(path.read_text(), path, "exec"), loaded.__dict__)
        digests._source.cache_clear()
        digests.sources_digest.cache_clear()
        return loaded

    yield load
    for name in ("pieces", "edited"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    "edit",
    [
        {"factor": "2.5"},
        {"factor": "2"},
        {"factor": "True"},
        {"table": "[1.0, 3.0]"},
        {"table": "[1, 2]"},
        {"table": "[[1.0, 2.0]]"},
        {"offset": "2.0"},
        {"wall": "3"},
        {"default_y": "1.0"},
        {"default": ", z=1.0"},
        {"flags": "(error_model='numpy')"},
        {"after": "outer.py_func.__defaults__ = (1,)"},
        {"after": "inner.py_func.__code__ = (lambda x: x * FACTOR + TABLE[0] + OFFSETS[0]).__code__"},
        {"after": "@inline_kernel\ndef inner(x):\n    return x * FACTOR - TABLE[0] + OFFSETS[1]"},
        {"after": "@inline_kernel\ndef inner(x):\n    return x * FACTOR + TABLE[0] + OFFSETS[1] + 0.5"},
        {"after": "def min(x, y):\n    return x\nmath = __import__('cmath')"},
    ],
    ids=str,
)
def test_edit_of_what_a_kernel_refers_to_changes_its_digest(
    module: Callable[..., ModuleType], edit: dict[str, str]
) -> None:
    assert kernel_digest(module().root) != kernel_digest(module(**edit).root)


@pytest.mark.parametrize(
    "edit",
    [
        {},
        {"unused": "2"},
        {"before": "# A comment, and lines that move.\n\n\nOTHER = 5"},
        {"after": "@kernel_with_cache\ndef other(x):\n    return root(x)"},
    ],
    ids=str,
)
def test_other_edits_leave_the_digest(module: Callable[..., ModuleType], edit: dict[str, str]) -> None:
    assert kernel_digest(module().root) == kernel_digest(module(**edit).root)


def test_value_of_an_unknown_kind_counts_by_the_sources(module: Callable[..., ModuleType]) -> None:
    known, thing = {"after": "# Edited."}, {"before": "class Thing:\n    x = 1.0", "factor": "{'x': 1.0}"}
    assert kernel_digest(module().root) == kernel_digest(module(**known).root)
    assert kernel_digest(module(**thing).root) != kernel_digest(module(**thing, **known).root)


def make(first: float, second: float) -> Any:
    @numba.njit
    def one(x: float) -> float:
        return x + first

    @numba.njit
    def other(x: float) -> float:
        return x + second

    @numba.njit
    def both(x: float) -> float:
        return one(x) - other(x)

    return both


def test_closures_count_by_their_values_and_places() -> None:
    assert kernel_digest(make(1.0, 2.0)) == kernel_digest(make(1.0, 2.0))
    assert len({kernel_digest(make(*values)) for values in ((1.0, 2.0), (2.0, 1.0), (1.0, 1.0), (-0.0, 0.0))}) == 4
    assert kernel_digest(make(0.0, -0.0)) != kernel_digest(make(0.0, 0.0))


def test_kernels_that_call_each_other_end() -> None:
    @numba.njit
    def even(n: int) -> bool:
        return n == 0 or odd(n - 1)

    @numba.njit
    def odd(n: int) -> bool:
        return n != 0 and even(n - 1)

    assert kernel_digest(even) != kernel_digest(odd)


@pytest.mark.parametrize("package", [numba, llvmlite, digests.np], ids=lambda package: package.__name__)
def test_other_version_of_a_compiler_changes_all_digests(
    package: ModuleType, module: Callable[..., ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = kernel_digest(module().root)
    monkeypatch.setattr(package, "__version__", "9.9.9")
    digests._compilers.cache_clear()
    after = kernel_digest(module().root)
    monkeypatch.undo()
    digests._compilers.cache_clear()
    assert after != before


def test_intrinsics_count_by_their_sources_and_what_they_are_made_of() -> None:
    from readygo.common.simd import types as simd

    part = digests._value_part(simd.fma)
    assert digests.sources_digest(Path(simd.__file__)) in part
    assert digests._value_part(simd.minimum) != digests._value_part(simd.maximum)


def test_classes_behind_argument_types_count(module: Callable[..., ModuleType]) -> None:
    def of_point(**edit: str) -> str:
        point = sys.modules["pieces"].Point if module(**edit) else None
        return type_digest((numba.types.UniTuple(numba.types.NamedUniTuple(numba.float64, 2, point), 3),))

    assert of_point() == of_point(factor="9.0")
    assert of_point() != of_point(default_y="2.0")
    assert type_digest((numba.float64,)) != type_digest((numba.float32,))


def test_types_of_readygo_count_by_their_sources() -> None:
    from readygo.common.simd import types as simd

    assert digests.sources_digest(Path(simd.__file__)) in digests._type_part(simd.F16)


def test_what_a_package_loads_lazily_is_imported_by_whoever_imports_the_package() -> None:
    root = Path(digests.__file__).parents[1]
    found = digests._with_imports(root / "services" / "driver" / "risks.py")
    assert root / "common" / "episode" / "__init__.py" in found
    assert root / "common" / "episode" / "collision.py" in found
