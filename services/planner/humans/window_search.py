"""Grid searches that look at a window of a large map first, with the result of a search of the whole map."""

import math

import numpy as np

from readygo.common.arrays import Int64Array, UInt8Array
from readygo.common.episode import GridSearch
from readygo.common.episode.grid_search import FREE
from readygo.common.kernels import kernel_with_cache

Cell = tuple[int, int]


class WindowSearch:
    """Working memory for searches on grids of one shape; not thread-safe."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._search = GridSearch(shape)

    def path(self, factor: UInt8Array, start: Cell, goal: Cell, *, longest: float) -> Int64Array | None:
        """Cheapest way between two cells, see `GridSearch.path`; None if there is none, or none of a length.

        Windows around the two cells are searched first: a way in one of them is the map's cheapest if no way that
        leaves the window can be cheaper. The largest window holds every way of interest. A longer way may be
        returned, if it is the cheapest one.

        Args:
            factor: Cost factors, shape (H, W).
            start: Row and column.
            goal: Row and column.
            longest: Length beyond which a way is of no interest [cells].
        """
        direct = math.hypot(goal[0] - start[0], goal[1] - start[1])
        # Half the minor axis of the ellipse of all such ways; along its major axis less would do.
        largest = math.ceil(0.5 * math.sqrt(max(longest * longest - direct * direct, 0.0))) + 2
        for margin in (largest // 3, largest):
            found = self._in_window(factor, start, goal, margin)
            if isinstance(found, bool):
                break
            outside = 5 * FREE * (2 * margin + min(abs(start[0] - goal[0]), abs(start[1] - goal[1])))
            if found is not None and _cost(found, factor) < outside:
                return found
            if found is None and margin == largest:
                return None
        return self._search.path(factor, start, goal)

    def connects(self, factor: UInt8Array, start: Cell, goal: Cell, *, margin: int) -> bool:
        """True if some way leads from one cell to another; a window with a margin [cells] is searched first."""
        found = self._in_window(factor, start, goal, margin)
        if found is not None and not isinstance(found, bool):
            return True
        return self._search.path(factor, start, goal) is not None

    def _in_window(self, factor: UInt8Array, start: Cell, goal: Cell, margin: int) -> Int64Array | bool | None:
        """The cheapest way inside of a window, None if there is none, False if the window is most of the map."""
        i, j = max(min(start[0], goal[0]) - margin, 0), max(min(start[1], goal[1]) - margin, 0)
        rows, columns = slice(i, max(start[0], goal[0]) + margin + 1), slice(j, max(start[1], goal[1]) + margin + 1)
        window = factor[rows, columns]
        if 2 * window.size > factor.size:
            return False
        search = GridSearch((window.shape[0], window.shape[1]))
        cells = search.path(np.ascontiguousarray(window), (start[0] - i, start[1] - j), (goal[0] - i, goal[1] - j))
        return None if cells is None else cells + np.array((i, j))


@kernel_with_cache
def _cost(cells: Int64Array, factor: UInt8Array) -> int:
    """What the search counts for a way that was flooded from its end."""
    total = 0
    for k in range(len(cells) - 1):
        straight = cells[k, 0] == cells[k + 1, 0] or cells[k, 1] == cells[k + 1, 1]
        total += (5 if straight else 7) * int(factor[cells[k, 0], cells[k, 1]])
    return total
