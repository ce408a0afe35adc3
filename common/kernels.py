"""How functions become machine code, and where it is kept: decorators for every kernel of readygo.

Numba compares the file of a compiled function only, so an edited function or constant of another file would leave stale
machine code behind, and with it other samples. Here code is kept in a folder of its own for each state of a module and
of all that it imports of readygo, below the user's cache folder (or `NUMBA_CACHE_DIR`). Nothing is set for functions
that others compile.
"""

import contextlib
import functools
import hashlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from readygo.common.files import cache_root, make_cache_folder

_THIS = Path(__file__).absolute()
_PACKAGE = _THIS.parents[1]
_IMPORT = re.compile(rb"^(?:from|import) readygo\.?([.\w]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
_LAZY_IMPORT = re.compile(_IMPORT.pattern.replace(b"^", rb"^[ \t]*", 1), re.MULTILINE)
"""Packages name below `if TYPE_CHECKING` what they load when it is used: whoever imports them may use it."""
_STATES_KEPT = 4
"""States of a module whose machine code is kept, those used last."""
_njit: Any = numba.njit
_settings: Any = config
F = TypeVar("F", bound=Callable[..., Any])


@overload
def compiled(function: F) -> F: ...
@overload
def compiled(**flags: Any) -> Callable[[F], F]: ...
def compiled(function: Any = None, **flags: Any) -> Any:
    """Compile a function with numba's `njit`, and keep the machine code for later processes.

    Use it as `@compiled`, or `@compiled(error_model="numpy")` with flags of `njit`.

    Raises:
        ReadygoError: At the first call, if nothing can be kept.
    """
    if function is None:
        return functools.partial(compiled, **flags)
    dispatcher = _njit(**flags)(function)
    dispatcher._cache = _KernelCache(function)  # type: ignore[no-untyped-call]
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls.

    Without numba's reference counting: it would count the workspace's arrays up and down in every inner function, at
    twice the cost of the kernels themselves. Kernels therefore allocate nothing. No `fastmath`: see `simd.types`.
    """
    return compiled(error_model="numpy", _nrt=False)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function that becomes part of the kernels that call it."""
    return _njit(forceinline=True, error_model="numpy", _nrt=False)(function)


@functools.cache
def sources_digest(path: Path) -> str:
    """Hash of a source file and of all files that it imports of readygo, directly or not."""
    digest = hashlib.sha256()
    for source in sorted(_with_imports(path)):
        digest.update(_source(source)[0])
    return digest.hexdigest()[:16]


def _with_imports(path: Path) -> set[Path]:
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting += _source(source)[1]
    return found


@functools.cache
def _source(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """Digest of a file as it is when it is imported, and the files that it imports itself."""
    text = path.read_bytes()
    # The cache folder and its errors are no part of any kernel.
    files = (
        () if path == _THIS else tuple(_imported_files(text, _LAZY_IMPORT if path.name == "__init__.py" else _IMPORT))
    )
    return hashlib.sha256(text).digest(), files


def _imported_files(text: bytes, imports: re.Pattern[bytes]) -> Iterator[Path]:
    for module, names in imports.findall(text):
        place = _PACKAGE.joinpath(*module.decode().split(".")) if module else _PACKAGE
        candidates = [place.with_suffix(".py")]
        if (place / "__init__.py").is_file():
            candidates = [place / "__init__.py"]
            candidates += [place / f"{name.decode()}.py" for name in re.findall(rb"\w+", names)]
        yield from (candidate for candidate in candidates if candidate.is_file())


class _StateFolder(_CacheLocator):
    """The folder of a function's module in its present state."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._py_file = function.__code__.co_filename
        self._line = function.__code__.co_firstlineno
        self._digest = sources_digest(Path(self._py_file))
        base = Path(_settings.CACHE_DIR) if _settings.CACHE_DIR else cache_root() / "kernels"
        self._folder = base / function.__module__ / self._digest

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_StateFolder":
        return cls(py_func)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._digest

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        is_new = not self._folder.is_dir()
        make_cache_folder(self._folder)
        if is_new:
            _forget_old_states(self._folder.parent)


class _Kept(CompileResultCacheImpl):
    _locator_classes = (_StateFolder,)  # type: ignore[assignment]


class _KernelCache(FunctionCache):
    """Machine code of a function on disk."""

    _impl_class = _Kept

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = None
        with contextlib.suppress(OSError):
            found = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        if found is None:
            # Before minutes of compilation, not after them.
            self._impl.locator.ensure_cache_path()
        else:
            with contextlib.suppress(OSError):
                os.utime(self.cache_path)
        return found


def _forget_old_states(folder: Path) -> None:
    # Another process may be doing the same.
    with contextlib.suppress(OSError):
        states = sorted(folder.iterdir(), key=lambda state: state.stat().st_mtime, reverse=True)
        for state in states[_STATES_KEPT:]:
            shutil.rmtree(state, ignore_errors=True)
