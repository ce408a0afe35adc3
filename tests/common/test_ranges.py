from dataclasses import dataclass

import numpy as np
import pytest

from readygo.common.ranges import Range, Ranges


@dataclass(frozen=True, kw_only=True)
class Weather(Ranges):
    wind: Range = ()
    rain: Range = ()


def test_values_are_of_their_ranges_and_one_range_changes_no_other_value() -> None:
    both = Weather(wind=(1.0, 3.0), rain=(-1.0, 0.0))
    drawn = [both.drawn_values(np.random.default_rng(seed)) for seed in range(20)]
    assert all(1.0 <= value["wind"] <= 3.0 and -1.0 <= value["rain"] <= 0.0 for value in drawn)
    assert len({value["rain"] for value in drawn}) == 20
    alone = [Weather(rain=(-1.0, 0.0)).drawn_values(np.random.default_rng(seed)) for seed in range(20)]
    assert alone == [{"rain": value["rain"]} for value in drawn]
    assert both.varies
    assert not Weather().varies


@pytest.mark.parametrize("ends", [(1.0,), (2.0, 1.0), (0.0, float("inf"))])
def test_what_is_no_range_is_refused(ends: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"rain must be \[lowest, highest\]"):
        Weather(rain=ends).check(lambda name, value: None)


def test_values_are_drawn_evenly_from_their_ranges_in_the_order_of_the_fields() -> None:
    weather = Weather(wind=(1.0, 3.0), rain=(-2.0, 4.0))
    shares = np.random.default_rng(7).random(2)
    found = weather.drawn_values(np.random.default_rng(7))
    assert found == {"wind": pytest.approx(1.0 + 2.0 * shares[0]), "rain": pytest.approx(-2.0 + 6.0 * shares[1])}
    assert weather.items() == [("wind", (1.0, 3.0)), ("rain", (-2.0, 4.0))]


def test_both_ends_of_every_range_are_checked_by_name_and_a_range_may_be_a_point() -> None:
    asked: list[tuple[str, float]] = []
    Weather(wind=(2.0, 2.0), rain=(-1.0, 5.0)).check(lambda *what: asked.append(what))
    assert asked == [("wind", 2.0), ("wind", 2.0), ("rain", -1.0), ("rain", 5.0)]
    with pytest.raises(ValueError, match=r"wind must be \[lowest, highest\], got \[1.0, 2.0, 3.0\]"):
        Weather(wind=(1.0, 2.0, 3.0)).check(lambda name, value: None)
    with pytest.raises(ValueError, match="wind must be"):
        Weather(wind=(float("nan"), 2.0)).check(lambda name, value: None)
