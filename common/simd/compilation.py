"""How the kernels are compiled and cached."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache


def _source_digest() -> str:
    """Hash of the sources that become part of kernels."""
    digest = hashlib.sha256()
    common = Path(__file__).resolve().parents[1]
    for room in ("simd", "images", "rasterizer"):
        for path in sorted((common / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


_njit: Any = numba.njit
_SOURCES = _source_digest()


class _PackageCache(FunctionCache):
    """Numba's cache on disk; an entry is valid for one state of the whole package.

    Numba itself looks at the file of the compiled function only, and would keep kernels whose inlined parts have
    changed.
    """

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (super()._index_key(sig, codegen), _SOURCES)  # type: ignore[no-untyped-call]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls.

    Without numba's reference counting: it would count the workspace's arrays up and down in every inner function, at
    twice the cost of the kernels themselves. Kernels therefore allocate nothing. No `fastmath`: see `simd_types`.
    """
    dispatcher = _njit(cache=True, error_model="numpy", _nrt=False)(function)
    dispatcher._cache = _PackageCache(function)  # type: ignore[no-untyped-call]
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function that becomes part of the kernels that call it."""
    return _njit(forceinline=True, error_model="numpy", _nrt=False)(function)
