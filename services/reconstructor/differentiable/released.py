"""Kernels that let other threads of Python run beside them, so that the views of a batch are drawn side by side."""

from collections.abc import Callable
from typing import Any

from readygo.common.kernels import kernel_with_cache


def kernel_without_gil(function: Callable[..., Any]) -> Any:
    """Compile a function as `readygo.common.kernels.kernel` does, without the interpreter's lock while it runs."""
    return kernel_with_cache(error_model="numpy", _nrt=False, nogil=True)(function)
