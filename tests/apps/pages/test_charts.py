import re
from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.pages.charts import Curve, line_chart, meter, share_bar


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
    assert (float(x), float(y)) == (372.0, 123.0), "at the right, half way up"
    many = line_chart([Curve(name="a", x=np.arange(100.0), y=np.arange(100.0))], x_name="step")
    assert "<circle" not in many


def test_curves_begin_at_the_left_where_x_is_0_and_no_legend_lies_over_them() -> None:
    chart = line_chart([Curve(name="a", x=np.array([5.0, 10.0]), y=np.array([100.0, 100.0]))], x_name="x", y_max=100.0)
    assert re.search(r'points="213\.0,46\.0 372\.0,46\.0"', chart)
    assert max(float(y) for y in re.findall(r'<rect [^>]*y="([\d.]+)"', chart)) < 46.0


def test_both_curves_of_a_loss_share_a_logarithmic_axis_with_round_ticks() -> None:
    curves = [
        Curve(name=name, x=np.array([12_032.0, 1_678_976.0]), y=np.array(y))
        for name, y in (("training", [7.5, 1.5]), ("held out", [0.34, 0.1]))
    ]
    chart = line_chart(curves, x_name="samples")
    assert chart.count("<polyline") == 2
    assert "Loss, logarithmic" in chart
    texts = re.findall(r">([^<>]+)</text>", chart)
    assert {"0.1", "1", "10", "500,000", "1.5M"} <= set(texts)
    assert all(re.fullmatch(r"[\d,.]+M?|\D.*", text) for text in texts)
    assert max(float(x) for x in re.findall(r'<text x="([\d.]+)"', chart)) < 400


def test_meter_puts_the_interval_on_the_bar() -> None:
    bar = meter(0.5, 0.25, 0.75)
    assert '<i style="width:50.0%">' in bar
    assert '<u style="left:25.0%;width:50.0%">' in bar


def test_charts_look_as_they_did(golden_page: Callable[[str, str], None]) -> None:
    x = np.array([3.0, 17.0, 41.0])
    below = Curve(name="<left>", x=x, y=np.array([-0.7, 0.4, 2.3]))
    above = Curve(name="right", x=np.array([5.0, 29.0]), y=np.array([1.1, 3.9]))
    wide = Curve(name="loss", x=x, y=np.array([88.0, 0.7, 4.1]))
    many = [Curve(name=str(k), x=x[:2], y=np.array([k + 0.5, 2.0])) for k in range(5)]
    charts = [
        line_chart([below, above], x_name="time [s] & more", what="<Rate>"),
        line_chart([wide], x_name="epoch"),
        line_chart([wide], x_name="epoch", y_max=95.0),
        line_chart(many, x_name="step", y_max=1.0),
    ]
    golden_page("line_charts", "\n\n".join([*charts, meter(0.3, 0.12, 0.71), meter(-0.1, -0.2, 1.4), share_bar(0.37)]))


@pytest.mark.parametrize(("span", "kind"), [(20.0, "Loss<"), (20.1, "Loss, logarithmic<")])
def test_axis_is_logarithmic_above_a_factor_of_20(span: float, kind: str) -> None:
    chart = line_chart([Curve(name="a", x=np.array([1.0, 2.0]), y=np.array([0.3, 0.3 * span]))], x_name="x")
    assert f">{kind}" in chart


@pytest.mark.parametrize("count", [30, 31])
def test_curve_of_30_points_has_dots(count: int) -> None:
    chart = line_chart([Curve(name="a", x=np.arange(count) + 1.0, y=np.arange(count) + 5.0)], x_name="x")
    assert chart.count("<circle") == (30 if count == 30 else 0)
    assert line_chart([Curve(name="a", x=np.array([0.0]), y=np.array([1.0]))], x_name="x").count("<circle") == 1
