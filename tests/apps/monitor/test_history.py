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


def test_rates_are_the_rises_over_the_window_before_each_row() -> None:
    rng = np.random.default_rng(2)
    x = np.cumsum(rng.uniform(0.2, 3.0, 60))
    y = np.cumsum(rng.uniform(0.0, 5.0, 60))
    history = History()
    for k, (one, value) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        history.add(one, (-1.0, value))
        earlier = [i for i in range(k) if x[i] >= one - 7.0] or [k - 1]
        want = np.nan if k == 0 else (y[k] - y[earlier[0]]) / (x[k] - x[earlier[0]])
        np.testing.assert_allclose(history.rate(1, 7.0), want)
        np.testing.assert_allclose(history.rates(1, 7.0)[1][-1], want)
    assert history.curve(0)[1].tolist() == [-1.0] * 60


def test_rows_are_thinned_out_when_there_is_one_too_many() -> None:
    history = History(points_max=6)
    for x in range(6):
        history.add(x, (10.0 * x,))
    assert len(history) == 6
    history.add(6, (60.0,))
    assert history.curve(0)[0].tolist() == [0.0, 2.0, 4.0, 6.0]
    history.add(7.9, (79.0,))
    history.add(8.0, (80.0,))
    assert [column.tolist() for column in history.curve(0)] == [
        [0.0, 2.0, 4.0, 6.0, 8.0],
        [0.0, 20.0, 40.0, 60.0, 80.0],
    ]
