import re

import numpy as np
import pytest

from readygo.apps.pages.charts import Curve, line_chart, number_text, rate_bar


def test_line_chart_leaves_out_what_is_not_finite_and_turns_logarithmic() -> None:
    step = np.arange(4.0)
    assert line_chart([Curve(name="a", x=step, y=np.full(4, np.nan))], x_name="step") == ""
    linear = line_chart([Curve(name="a", x=step, y=np.array([4.0, 3.0, np.inf, 2.0]))], x_name="step")
    assert len(re.findall(r"[\d.]+,[\d.]+", re.search(r'points="([^"]*)"', linear).group(1))) == 3
    wide = line_chart([Curve(name="a", x=step, y=np.array([10.0, 1.0, 0.1, 0.01]))], x_name="step")
    heights = [float(pair.split(",")[1]) for pair in re.search(r'points="([^"]*)"', wide).group(1).split()]
    np.testing.assert_allclose(np.diff(heights), np.diff(heights)[0], atol=0.2)


@pytest.mark.parametrize("loss", [[0.0, 0.0], [1.0], [-2.0, -1.0]])
def test_line_chart_draws_odd_curves(loss: list[float]) -> None:
    curve = Curve(name="a", x=np.arange(float(len(loss))), y=np.array(loss))
    assert "nan" not in line_chart([curve], x_name="epoch")


def test_single_measurement_is_seen() -> None:
    chart = line_chart([Curve(name="a", x=np.array([5.0]), y=np.array([50.0]))], x_name="minutes", y_max=100.0)
    (x, y) = re.search(r'<circle cx="([\d.]+)" cy="([\d.]+)"', chart).groups()
    assert (float(x), float(y)) == (704.0, 137.0), "at the right, half way up"
    many = line_chart([Curve(name="a", x=np.arange(100.0), y=np.arange(100.0))], x_name="step")
    assert "<circle" not in many


def test_curves_begin_at_the_left_where_x_is_0_and_no_legend_lies_over_them() -> None:
    chart = line_chart([Curve(name="a", x=np.array([5.0, 10.0]), y=np.array([100.0, 100.0]))], x_name="x", y_max=100.0)
    assert re.search(r'points="381\.0,34\.0 704\.0,34\.0"', chart)
    assert max(float(y) for y in re.findall(r'<rect [^>]*y="([\d.]+)"', chart)) < 34.0


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (0.125, "0.125"), (1500.0, "1,500"), (2.5e6, "2.5M"), (1e-4, "1.0e-04")]
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert number_text(value) == text


def test_rate_bar_puts_the_interval_around_the_rate() -> None:
    bar = rate_bar(0.5, 0.25, 0.75)
    assert 'x1="42.0" x2="118.0"' in bar
    assert 'cx="80.0"' in bar
