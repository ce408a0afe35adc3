import math

import numpy as np
import pytest

from readygo.services.evaluator.statistics import bootstrap_interval, mcnemar_p


def test_interval_holds_the_mean_narrows_with_episodes_and_is_repeatable():
    rng = np.random.default_rng(0)
    few, many = rng.normal(3.0, 1.0, (20, 1)), rng.normal(3.0, 1.0, (2000, 1))
    low, high = bootstrap_interval(few)
    assert low < few.mean() < high
    assert bootstrap_interval(few) == (low, high)
    narrow_low, narrow_high = bootstrap_interval(many)
    assert narrow_high - narrow_low == pytest.approx(2 * 1.96 / math.sqrt(2000), rel=0.15)


def test_matched_rows_are_resampled_together():
    ours = np.arange(1.0, 11.0)
    low, high = bootstrap_interval(np.stack([2 * ours, ours], axis=1), lambda means: means[:, 0] / means[:, 1])
    assert low == pytest.approx(2.0)
    assert high == pytest.approx(2.0)


def test_interval_of_nothing_is_not_a_number():
    assert all(map(math.isnan, bootstrap_interval(np.empty((0, 1)))))
    assert all(map(math.isnan, bootstrap_interval(np.zeros((5, 2)), lambda means: means[:, 0] / means[:, 1])))


def test_mcnemar_is_the_binomial_test():
    assert mcnemar_p(0, 0) == 1.0
    assert mcnemar_p(3, 3) == 1.0
    assert mcnemar_p(0, 5) == pytest.approx(2 / 32)
    assert mcnemar_p(1, 9) == mcnemar_p(9, 1) == pytest.approx(2 * 11 / 1024)
    with pytest.raises(ValueError, match="must not be negative"):
        mcnemar_p(-1, 2)
