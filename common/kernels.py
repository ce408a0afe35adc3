"""How functions become machine code: decorators for every kernel of readygo.

Machine code is kept below the user's cache folder (or `NUMBA_CACHE_DIR`), see `kernel_cache`. Nothing is set for
functions that others compile.
"""

import functools
from collections.abc import Callable
from typing import Any, TypeVar, overload

from numba.core import config, dispatcher, sigutils
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from readygo.common.kernel_cache import KernelCache

_settings: Any = config
_dispatcher: Any = dispatcher
_sigutils: Any = sigutils
F = TypeVar("F", bound=Callable[..., Any])


@overload
def kernel_with_cache(function: F) -> F: ...
@overload
def kernel_with_cache(**flags: Any) -> Callable[[F], F]: ...
def kernel_with_cache(function: Any = None, **flags: Any) -> Any:
    """Compile a function like numba's `njit`, and keep the machine code for later processes.

    Use it as `@kernel_with_cache`, or `@kernel_with_cache(error_model="numpy")` with flags of `njit`.

    Raises:
        ReadygoError: At the first call, if nothing can be kept.
    """
    if function is None:
        return functools.partial(kernel_with_cache, **flags)
    made = _dispatcher_of(function, flags)
    if isinstance(made, KernelDispatcher):
        made._cache = KernelCache(made)
    return made


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls.

    Without numba's reference counting: it would count the workspace's arrays up and down in every inner function, at
    twice the cost of the kernels themselves. Kernels therefore allocate nothing. No `fastmath`: see `simd.types`.
    """
    return kernel_with_cache(error_model="numpy", _nrt=False)(function)


def inline_kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that becomes part of the kernels that call it."""
    return _dispatcher_of(function, {"forceinline": True, "error_model": "numpy", "_nrt": False})


def _dispatcher_of(function: Callable[..., Any], flags: dict[str, Any]) -> Any:
    if _settings.DISABLE_JIT:
        return function
    return KernelDispatcher(function, targetoptions={"nopython": True, **flags})  # type: ignore[no-untyped-call]


class _Compiler(_dispatcher._FunctionCompiler):
    """Adds the flags that depend on the caller."""

    python_entry = True
    """True while Python calls, false while another kernel does."""

    def _customize_flags(self, flags: Any) -> Any:
        flags.no_cfunc_wrapper = True
        flags.no_cpython_wrapper = not self.python_entry
        return flags


class KernelDispatcher(CPUDispatcher):
    """A compiled function that has an entry for Python only if Python calls it.

    The entry converts each argument, and each array of a named tuple: a small function compiles faster than its entry.
    """

    def __init__(
        self, py_func: Any, locals: Any = None, targetoptions: Any = None, pipeline_class: Any = Compiler
    ) -> None:
        super().__init__(py_func, locals, targetoptions, pipeline_class)  # type: ignore[no-untyped-call]
        self._compiler: Any = _Compiler(  # type: ignore[no-untyped-call]
            py_func, self.targetdescr, self.targetoptions, self.locals, pipeline_class
        )
        self._cache: Any = self._cache
        self._without_entry: set[Any] = set()

    @property
    def python_entry(self) -> bool:
        """True if what is compiled or loaded next has an entry for Python."""
        return bool(self._compiler.python_entry)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks for when another kernel calls this one."""
        before, self._compiler.python_entry = self._compiler.python_entry, False
        try:
            return super().get_call_template(args, kws)  # type: ignore[no-untyped-call]
        finally:
            self._compiler.python_entry = before

    def compile(self, sig: Any) -> Any:
        """Compile a signature, or load it; once more when Python calls what only kernels have called so far."""
        with global_compiler_lock:
            args = tuple(_sigutils.normalize_signature(sig)[0])
            if self.python_entry and args in self._without_entry:
                self._without_entry.remove(args)
                del self.overloads[args]
            return super().compile(sig)  # type: ignore[no-untyped-call]

    def add_overload(self, cres: Any) -> None:
        """Hide from Python what has no entry: a call would crash."""
        if self.python_entry:
            super().add_overload(cres)  # type: ignore[no-untyped-call]
        else:
            args = tuple(cres.signature.args)
            self.overloads[args] = cres
            self._without_entry.add(args)
