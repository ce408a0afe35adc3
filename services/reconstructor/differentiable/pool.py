"""Memory that is handed out again once no array refers to it any more."""

import mmap
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray


@dataclass
class _Region:
    memory: mmap.mmap
    user: "weakref.ref[npt.NDArray[Any]]"


class ArrayPool:
    """Large arrays without the cost of new pages: a fresh 30 MB array costs more time than filling it.

    An array is in use as long as it, a view of it or a tensor made from one of these lives. Not for several threads.
    """

    def __init__(self) -> None:
        self._regions: dict[str, list[_Region]] = {}

    def take(self, name: str, count: int, dtype: npt.DTypeLike) -> AnyArray:
        """Uninitialised array, shape (count,).

        Args:
            name: Arrays of one name share memory in turn.
            count: Number of elements.
            dtype: Their type.
        """
        size = max(count * np.dtype(dtype).itemsize, 1)
        regions = self._regions.setdefault(name, [])
        free = [region for region in regions if region.user() is None]
        region = next((region for region in free if len(region.memory) >= size), None)
        if region is None:
            # Free ones are all too small.
            self._regions[name] = [region for region in regions if region.user() is not None]
            region = _Region(_pages(size + size // 4), lambda: None)  # type: ignore[arg-type]
            self._regions[name].append(region)
        array: AnyArray = np.frombuffer(region.memory, dtype=dtype, count=count)
        region.user = weakref.ref(array)
        return array


def _pages(size: int) -> mmap.mmap:
    memory = mmap.mmap(-1, size)
    if hasattr(mmap, "MADV_HUGEPAGE"):
        memory.madvise(mmap.MADV_HUGEPAGE)
    return memory
