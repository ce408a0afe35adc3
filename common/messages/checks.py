"""Worded checks that messages run on their fields."""

import re
from typing import Any

import numpy as np

NAME_MAX = 200
"""Characters of a name at most."""
_SHA256 = re.compile(r"[0-9a-f]{64}")
_PATH_MAX = 1000
"""Most characters of a path."""


def check_sha256(name: str, text: str, *, empty: bool = False) -> None:
    """Raise ValueError unless `text` is a SHA-256 in hexadecimal digits, or is empty where it may be."""
    if not _SHA256.fullmatch(text) and (text or not empty):
        what = "empty or 64" if empty else "64"
        raise ValueError(f"{name} must be {what} hexadecimal digits, got {text[:100]!r}.")


def check_relative_path(name: str, path: str) -> None:
    """Raise ValueError unless `path` leads from a folder to something in it, with forward slashes and without dots."""
    parts = path.split("/")
    if not {"", ".", ".."}.isdisjoint(parts) or "\\" in path or "\0" in path or len(path) > _PATH_MAX:
        raise ValueError(f"{name} must be a path within a folder, got {path[:100]!r}.")


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
