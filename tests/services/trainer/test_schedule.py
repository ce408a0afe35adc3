import pytest

from readygo.services.trainer.config import OptimizerConfig
from readygo.services.trainer.schedule import RateSchedule

CONFIG = OptimizerConfig(learning_rate=1e-3, decay_share=0.2)


def test_rate_warms_up_stays_and_falls_over_the_last_fifth():
    schedule = RateSchedule(CONFIG)
    assert schedule.rate(0, 0.0) == pytest.approx(2e-5)
    assert schedule.rate(49, 0.01) == schedule.rate(500, 0.79) == pytest.approx(1e-3)
    assert schedule.rate(900, 0.9) == pytest.approx(1e-3 * (0.01 + 0.99 * 0.5))
    assert schedule.rate(1000, 1.0) == pytest.approx(1e-5)
    assert schedule.end == 1.0


def test_fall_that_is_begun_early_ends_early_and_takes_the_same_share():
    schedule = RateSchedule(CONFIG)
    schedule.begin_decay(0.4)
    schedule.begin_decay(0.45)
    assert schedule.end == pytest.approx(0.5)
    assert schedule.rate(500, 0.45) == pytest.approx(1e-3 * (0.01 + 0.99 * 0.5))
    assert schedule.rate(500, 0.5) == pytest.approx(1e-5)


def test_fall_that_has_begun_is_not_begun_again():
    schedule = RateSchedule(CONFIG)
    schedule.begin_decay(0.9)
    assert schedule.decay_from is None
    assert schedule.end == 1.0


def test_constant_rate_never_falls():
    assert RateSchedule(OptimizerConfig(learning_rate=1e-4, decay_share=0.0)).rate(1000, 1.0) == 1e-4


def test_warm_up_and_fall_count_together():
    schedule = RateSchedule(OptimizerConfig(learning_rate=2e-3, decay_share=0.5))
    assert schedule.rate(9, 0.75) == pytest.approx(2e-3 * 10 / 50 * (0.01 + 0.99 * 0.5))
    assert schedule.rate(49, 0.5) == pytest.approx(2e-3)
    assert schedule.rate(100, 1.2) == pytest.approx(2e-5)


def test_fall_over_the_whole_budget_cannot_be_begun_early():
    schedule = RateSchedule(OptimizerConfig(learning_rate=1e-3, decay_share=1.0))
    schedule.begin_decay(0.3)
    assert (schedule.decay_from, schedule.end) == (None, 1.0)
    assert schedule.rate(50, 0.25) == pytest.approx(1e-3 * (0.01 + 0.99 * 0.75))


def test_fall_is_not_begun_before_anything_is_spent():
    schedule = RateSchedule(CONFIG)
    schedule.begin_decay(0.0)
    assert schedule.decay_from is None
    schedule.begin_decay(0.8)
    assert schedule.decay_from is None


def test_early_fall_takes_as_long_in_a_larger_budget_and_is_dropped_once_it_has_ended():
    schedule = RateSchedule(CONFIG)
    schedule.begin_decay(0.4)
    schedule.rescale(0.45, 0.225)
    assert (schedule.decay_from, schedule.end) == (pytest.approx(0.2), pytest.approx(0.25))
    assert schedule.rate(500, 0.225) == pytest.approx(1e-3 * (0.01 + 0.99 * 0.5))
    schedule.rescale(0.25, 0.125)
    assert (schedule.decay_from, schedule.end) == (None, 1.0)
    schedule.rescale(0.5, 0.25)
    assert schedule.decay_from is None
