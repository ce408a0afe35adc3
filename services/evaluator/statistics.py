"""How sure a number is that few episodes gave: intervals by resampling, and tests of matched episodes."""

import math
from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float64Array

DRAWS = 2000
"""Resamples of a bootstrap."""
LEVEL = 0.95

Statistic = Callable[[Float64Array], Float64Array]
"""Means of columns, shape (B, K), to what is wanted of each, shape (B,)."""


def bootstrap_interval(columns: Float64Array, statistic: Statistic | None = None) -> tuple[float, float]:
    """Percentile interval of a function of column means, over resampled rows; the same rows give the same interval.

    Args:
        columns: A row per episode: what is resampled together stays matched, shape (N, K).
        statistic: Function of the means; the first column's mean by default. Resamples in which it is not finite are
            left out.

    Returns:
        Lower and upper end; NaN if there is none.

    Source: Efron, Bootstrap methods: another look at the jackknife, Ann. Statist. 7 (1979).
    """
    if len(columns) == 0:
        return math.nan, math.nan
    rng = np.random.Generator(np.random.Philox(len(columns)))
    rows = rng.integers(0, len(columns), (DRAWS, len(columns)))
    means = columns[rows].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = means[:, 0] if statistic is None else statistic(means)
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return math.nan, math.nan
    low, high = np.quantile(values, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]).tolist()
    return low, high


def mcnemar_p(only_first: int, only_second: int) -> float:
    """Probability that two methods that are equally good differ at least this much; exact, two-sided.

    Args:
        only_first: Matched episodes in which only the first one succeeded.
        only_second: Those in which only the second one did.

    Source: McNemar, Note on the sampling error of the difference between correlated proportions, Psychometrika 12
    (1947); exact by the binomial distribution.
    """
    if only_first < 0 or only_second < 0:
        raise ValueError(f"counts must not be negative, got {only_first} and {only_second}.")
    count, fewer = only_first + only_second, min(only_first, only_second)
    tail = sum(math.comb(count, k) for k in range(fewer + 1))
    return min(1.0, float(2 * tail / 2**count))
