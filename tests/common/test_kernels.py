from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from readygo.common import kernel_cache, kernels
from readygo.common.kernel_cache import KernelCache
from readygo.common.kernels import KernelDispatcher, inline_kernel, kernel_with_cache


class Segment(NamedTuple):
    begin: float
    end: float


@inline_kernel
def length(segment: Segment) -> float:
    return segment.end - segment.begin


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache._settings, "CACHE_DIR", str(tmp_path))


def entries(function: KernelDispatcher) -> list[bool]:
    """For each compiled signature whether Python finds it."""
    return [args not in function._without_entry for args in function.overloads]


def test_entry_for_python_is_made_when_python_calls() -> None:
    @kernel_with_cache
    def half(segment: Segment) -> float:
        return 0.5 * (segment.end - segment.begin)

    @kernel_with_cache
    def longer(first: Segment, second: Segment) -> float:
        return max(half(first), half(second))

    assert longer(Segment(0.0, 2.0), Segment(1.0, 4.0)) == 1.5
    assert (entries(longer), entries(half)) == ([True], [False])
    assert half(Segment(2.0, 7.0)) == 2.5
    assert entries(half) == [True]
    assert longer(Segment(0.0, 2.0), Segment(1.0, 5.0)) == 2.0


def test_function_with_an_entry_serves_kernels_too() -> None:
    @kernel_with_cache
    def doubled(x: float) -> float:
        return 2.0 * x

    @kernel_with_cache
    def doubled_twice(x: float) -> float:
        return doubled(doubled(x))

    assert doubled(1.0) == 2.0
    assert doubled_twice(1.0) == 4.0
    assert entries(doubled) == [True]
    assert doubled.stats.cache_misses.total() == 1


def test_kernels_of_numba_may_call_ours() -> None:
    @numba.njit
    def theirs(x: float) -> float:
        return length(Segment(0.0, x))

    assert theirs(2.5) == 2.5


def test_recursive_kernel_is_compiled() -> None:
    @kernel_with_cache
    def factorial(n: int) -> int:
        return 1 if n < 2 else n * factorial(n - 1)

    assert factorial(5) == 120


def test_functions_of_others_keep_numbas_cache() -> None:
    @numba.njit(cache=True)
    def theirs(x: float) -> float:
        return x

    assert type(theirs._cache) is not KernelCache
    assert type(kernel_with_cache(theirs.py_func)._cache) is KernelCache


def test_flags_are_those_of_njit() -> None:
    @kernel_with_cache(error_model="numpy")
    def quotient(x: float, y: float) -> float:
        return x / y

    @kernel_with_cache
    def checked_quotient(x: float, y: float) -> float:
        return x / y

    assert quotient(1.0, 0.0) == float("inf")
    with pytest.raises(ZeroDivisionError):
        checked_quotient(1.0, 0.0)


def test_kernels_are_plain_functions_where_numba_is_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels._settings, "DISABLE_JIT", 1)

    def total(values: np.ndarray) -> float:
        return float(values.sum())

    assert kernel_with_cache(total) is total
    assert inline_kernel(total) is total
