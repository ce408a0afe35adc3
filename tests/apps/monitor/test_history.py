import numpy as np
import pytest

from readygo.apps.monitor.history import History


def test_rows_stay_bounded_and_reach_from_first_to_last() -> None:
    history = History(apart=1.0, points_max=50)
    for second in range(10_000):
        history.add(second, (2.0 * second,))
    x, y = history.curve(0)
    assert len(history) <= 51
    assert x[0] == 0.0
    assert x[-1] > 9_000
    np.testing.assert_array_equal(y, 2.0 * x)


def test_rows_that_come_too_soon_or_go_back_are_left_out() -> None:
    history = History(apart=1.0)
    for x in (0.0, 0.5, 1.0, 0.7, 2.0):
        history.add(x, (x,))
    assert history.curve(0)[0].tolist() == [0.0, 1.0, 2.0]
    history.clear()
    assert len(history) == 0


def test_rate_is_that_of_the_window() -> None:
    history = History()
    assert np.isnan(history.rate(0, 10.0))
    for second in range(100):
        history.add(second, (0.0 if second < 50 else 3.0 * (second - 50),))
    assert history.rate(0, 10.0) == pytest.approx(3.0)
    x, rates = history.rates(0, 10.0)
    assert np.isnan(rates[0])
    assert rates[30] == 0.0
    assert rates[-1] == pytest.approx(3.0)
    assert len(x) == 100
