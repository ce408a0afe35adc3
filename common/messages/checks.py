"""Worded checks that messages run on their arrays."""

from typing import Any

import numpy as np

NAME_MAX = 200
"""Characters of a name at most."""


def check_array(name: str, array: Any, dtype: Any, shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless `array` has this dtype and shape; None stands for any length."""
    if not isinstance(array, np.ndarray) or array.dtype != np.dtype(dtype) or array.ndim != len(shape):
        got = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
        raise ValueError(f"{name} must be {np.dtype(dtype)} of shape {shape}, got {got}.")
    if any(want is not None and want != have for want, have in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}.")


def check_printable(field: str, name: str, *, empty: bool = False) -> None:
    """Raise ValueError unless `name` is a line of printable characters: names end up in terminals, logs and pages.

    Args:
        field: What the name is, for the error.
        name: A name of a process, a host, a stage, an address.
        empty: True where it may be missing.
    """
    if not name and not empty:
        raise ValueError(f"{field} must not be empty.")
    if len(name) > NAME_MAX or not name.isprintable():
        raise ValueError(f"{field} must be at most {NAME_MAX} printable characters, got {name[:NAME_MAX]!a}.")
