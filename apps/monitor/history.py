"""Time series in bounded memory."""

import math
from collections.abc import Sequence

import numpy as np

from readygo.common.arrays import Float64Array

POINTS_MAX = 600


class History:
    """Rows of numbers over x; when there are too many, every second row is dropped and the spacing doubles."""

    def __init__(self, apart: float = 0.0, points_max: int = POINTS_MAX) -> None:
        """Make an empty history.

        Args:
            apart: Smallest distance of two rows in x.
            points_max: Largest number of rows.
        """
        self._apart, self._points_max = apart, points_max
        self._x: list[float] = []
        self._rows: list[tuple[float, ...]] = []

    def __len__(self) -> int:
        return len(self._x)

    def add(self, x: float, row: Sequence[float]) -> None:
        """Add a row, unless its x is too close to the last row's or below it."""
        if self._x and x - self._x[-1] < max(self._apart, 1e-12):
            return
        self._x.append(x)
        self._rows.append(tuple(row))
        if len(self._x) > self._points_max:
            span = self._x[-1] - self._x[0]
            del self._x[1:-1:2], self._rows[1:-1:2]
            self._apart = max(self._apart, span / self._points_max * 2)

    def clear(self) -> None:
        """Remove all rows."""
        self._x.clear()
        self._rows.clear()

    def curve(self, column: int) -> tuple[Float64Array, Float64Array]:
        """One column over x, shape (N,) each."""
        return np.array(self._x), np.array([row[column] for row in self._rows])

    def rate(self, column: int, window: float) -> float:
        """Rate of increase of a monotonic column over the last `window`, per unit of x; nan if unknown."""
        if len(self._x) < 2:
            return math.nan
        begin = self._x[-1] - window
        first = next(row for row, x in enumerate(self._x) if x >= begin)
        first = max(0, min(first, len(self._x) - 2))
        return (self._rows[-1][column] - self._rows[first][column]) / (self._x[-1] - self._x[first])

    def rates(self, column: int, window: float) -> tuple[Float64Array, Float64Array]:
        """Rates of increase of a monotonic column over the `window` before each row: x and rates, shape (N,) each."""
        x, y = self.curve(column)
        first = np.minimum(np.searchsorted(x, x - window), np.maximum(np.arange(len(x)) - 1, 0))
        span = x - x[first]
        rates = np.divide(y - y[first], span, out=np.full(len(x), np.nan), where=span > 0)
        return x, rates
