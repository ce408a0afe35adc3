import re

import numpy as np
import pytest

from readygo.apps.pages.charts import Curve, line_chart, rate_bar


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


def test_rate_bar_puts_the_interval_around_the_rate() -> None:
    bar = rate_bar(0.5, 0.25, 0.75)
    assert 'x1="42.0" x2="118.0"' in bar
    assert 'cx="80.0"' in bar
