"""Kernels that let other threads of Python run beside them, so that the views of a batch are drawn side by side."""

from collections.abc import Callable
from typing import Any

from readygo.common.kernels import compiled
from readygo.common.rasterizer.cpu import blend as tiles
from readygo.common.rasterizer.cpu.workspace import Workspace


def released(function: Callable[..., Any]) -> Any:
    """Compile a function as `readygo.common.kernels.kernel` does, without the interpreter's lock while it runs."""
    return compiled(error_model="numpy", _nrt=False, nogil=True)(function)


@released
def begin_slab(width: int, limit_bits: int, ws: Workspace) -> None:
    """See `readygo.common.rasterizer.cpu.blend`."""
    tiles.begin_slab(width, limit_bits, ws)


@released
def sort_keys(ws: Workspace) -> Any:
    """See `readygo.common.rasterizer.cpu.blend`."""
    return tiles.sort_keys(ws)


@released
def fill_tiles(width: int, in_sorted: bool, ws: Workspace) -> None:
    """See `readygo.common.rasterizer.cpu.blend`."""
    tiles.fill_tiles(width, in_sorted, ws)
