"""Machine code of kernels on disk: one file per kernel, argument types and state of all that the code depends on.

Numba's own cache compares the file of a compiled function only, so an edited function or constant of another file
would leave stale machine code behind, and with it other samples.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import warnings
from pathlib import Path
from typing import Any

from numba.core import caching, compiler, config, serialize, sigutils

from readygo.common.files import cache_root, make_cache_folder, write_whole
from readygo.common.kernel_digest import kernel_digest, type_digest

_KEPT = 16
"""Files of a kernel that are kept, those used last: signatures times states of the code."""
_UNREADABLE = (OSError, EOFError, pickle.UnpicklingError, ValueError, AttributeError, ImportError)
_settings: Any = config
_compiler: Any = compiler
_serialize: Any = serialize
_sigutils: Any = sigutils


class KernelCache(caching._Cache):
    """What is kept of one kernel; numba asks it before it compiles."""

    def __init__(self, dispatcher: Any) -> None:
        self._kernel = dispatcher
        base = Path(_settings.CACHE_DIR) if _settings.CACHE_DIR else cache_root() / "kernels"
        self._folder: Path = base / dispatcher.py_func.__module__

    @property
    def cache_path(self) -> str:
        """Folder of the kernels of a module."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code for argument types, or None; the folder is there then."""
        target_context.refresh()
        # Kernels can call what Python can.
        for entry in dict.fromkeys((self._kernel.python_entry, True)):
            path = self._path(sig, target_context.codegen(), entry=entry)
            with contextlib.suppress(*_UNREADABLE):
                found = _compiler.CompileResult._rebuild(target_context, *pickle.loads(path.read_bytes()))
                os.utime(path)
                return found
        # Before minutes of compilation, not after them.
        make_cache_folder(self._folder)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a result of compilation."""
        if data.library.has_dynamic_globals:
            warnings.warn(
                f"{self._kernel} refers to an address or a large array; it is compiled each time.", stacklevel=2
            )
            return
        path = self._path(sig, data.codegen, entry=self._kernel.python_entry)
        write_whole(path, _serialize.dumps(data._reduce()))
        self._forget_old()

    def enable(self) -> None:
        """Numba's switch; this cache is always on."""

    def disable(self) -> None:
        """Numba's switch; this cache is always on."""

    def flush(self) -> None:
        """Forget all that is kept of the kernel."""
        for path in self._files():
            path.unlink(missing_ok=True)

    def _path(self, sig: Any, codegen: Any, *, entry: bool) -> Path:
        key = (self._digest, type_digest(_sigutils.normalize_signature(sig)[0]), str(sig), codegen.magic_tuple(), entry)
        name = f"{self._name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.code"
        return self._folder / name

    @functools.cached_property
    def _digest(self) -> str:
        # At the first call: a kernel may refer to what its module defines later.
        return kernel_digest(self._kernel)

    @property
    def _name(self) -> str:
        return str(self._kernel.py_func.__qualname__)

    def _files(self) -> list[Path]:
        return [path for path in self._folder.glob("*.code") if path.name.rpartition("-")[0] == self._name]

    def _forget_old(self) -> None:
        # Another process may be doing the same.
        with contextlib.suppress(OSError):
            for path in sorted(self._files(), key=lambda file: file.stat().st_mtime, reverse=True)[_KEPT:]:
                path.unlink()
