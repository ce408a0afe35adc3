"""Ticks are round, and enclose what is drawn."""

import math

import pytest

from readygo.common.drawing.ticks import log_ticks, nice_ticks, number_text


def test_ticks_are_round_and_reach_the_highest_value() -> None:
    assert nice_ticks(0.0, 1_678_976.0) == [0.0, 500_000.0, 1e6, 1.5e6, 2e6]
    assert nice_ticks(0.0, 43.0) == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]


@pytest.mark.parametrize(("low", "high"), [(0.1, 7.5), (0.34, 0.34), (1.0, 1.0), (1e-5, 3.0), (0.02, 0.05)])
def test_logarithmic_ticks_enclose_the_values_and_are_round(low: float, high: float) -> None:
    ticks = log_ticks(low, high)
    assert len(ticks) >= 2
    assert ticks[0] <= low * (1 + 1e-9)
    assert high * (1 - 1e-9) <= ticks[-1]
    assert {round(tick / 10 ** math.floor(math.log10(tick) + 1e-9), 6) for tick in ticks} <= {1.0, 2.0, 5.0}


def test_logarithmic_ticks_of_a_narrow_interval_are_no_decades_apart() -> None:
    assert log_ticks(0.12, 0.31) == pytest.approx([0.1, 0.2, 0.5])
    assert log_ticks(1e-4, 3.0) == pytest.approx([1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0])


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (0.125, "0.125"), (1500.0, "1,500"), (2.5e6, "2.5M"), (1e-4, "1.0e-04")]
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert number_text(value) == text
