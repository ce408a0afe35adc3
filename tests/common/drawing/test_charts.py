import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from readygo.common.drawing.charts import (
    Curve,
    bar_chart,
    grid_chart,
    line_chart,
    log_ticks,
    nice_ticks,
    number_text,
    rose_chart,
    write_chart,
)


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


def test_intervals_are_a_band_around_the_curve_and_a_bar_through_a_single_point() -> None:
    x, y = np.array([0.0, 10.0]), np.array([40.0, np.nan])
    ends = np.array([[20.0, 0.0], [60.0, 0.0]])
    single = line_chart([Curve(name="a", x=x, y=y, interval=ends)], x_name="x", y_max=100.0)
    assert '<line x1="54" x2="54" y1="169.2" y2="107.6" stroke="currentColor"/>' in single
    band = line_chart([Curve(name="a", x=x, y=np.array([40.0, 80.0]), interval=ends + 10)], x_name="x", y_max=100.0)
    assert len(re.search(r'<polygon points="([^"]+)"', band).group(1).split()) == 4


def test_many_curves_have_their_names_in_rows_within_the_chart() -> None:
    curves = [Curve(name=f"a long name {k}", x=np.arange(2.0), y=np.arange(2.0)) for k in range(5)]
    root = ElementTree.fromstring(line_chart(curves, x_name="x"))
    names = [text.attrib for text in root.iter("text") if (text.text or "").startswith("a long")]
    assert len({name["y"] for name in names}) == 3
    assert max(float(name["x"]) for name in names) < 280
    assert [group.attrib["class"] for group in root.iter("g") if group.find("polyline") is not None] == [
        "c0", "c1", "c2", "c3", "c0",
    ]  # fmt: skip


def test_chart_file_is_an_svg_document_of_its_own(tmp_path: Path) -> None:
    write_chart(tmp_path / "a.svg", line_chart([Curve(name="a", x=np.arange(2.0), y=np.arange(2.0))], x_name="x"))
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "#0072b2" in (tmp_path / "a.svg").read_text()


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
    golden_page("line_charts", "\n\n".join(charts))


@pytest.mark.parametrize(("span", "kind"), [(20.0, "Loss<"), (20.1, "Loss, logarithmic<")])
def test_axis_is_logarithmic_above_a_factor_of_20(span: float, kind: str) -> None:
    chart = line_chart([Curve(name="a", x=np.array([1.0, 2.0]), y=np.array([0.3, 0.3 * span]))], x_name="x")
    assert f">{kind}" in chart


@pytest.mark.parametrize("count", [30, 31])
def test_curve_of_30_points_has_dots(count: int) -> None:
    chart = line_chart([Curve(name="a", x=np.arange(count) + 1.0, y=np.arange(count) + 5.0)], x_name="x")
    assert chart.count("<circle") == (30 if count == 30 else 0)
    assert line_chart([Curve(name="a", x=np.array([0.0]), y=np.array([1.0]))], x_name="x").count("<circle") == 1


def bars(svg: str) -> list[dict[str, str]]:
    root = ElementTree.fromstring(svg)
    return [rect.attrib | {"title": rect.findtext("title") or ""} for rect in root.iter("rect") if len(rect)]


def test_heights_of_bars_are_the_counts() -> None:
    svg = bar_chart(np.array([0.0, 1.0, 2.0]), np.array([4, 2]), axis="x [m]", count_name="Episodes")
    first, second = bars(svg)
    assert float(first["height"]) == pytest.approx(2 * float(second["height"]), abs=0.2)
    assert first["title"] == "0 to 1: 4"


def test_what_is_beyond_the_axis_is_named_only_if_there_is_any() -> None:
    rest = [("over 2", 3), ("never", 0)]
    svg = bar_chart(np.array([0.0, 1.0, 2.0]), np.array([4, 2]), axis="x", count_name="n", rest=rest)
    assert bars(svg)[-1]["title"] == "over 2: 3"
    assert "never" not in svg


def test_nothing_counted_still_gives_a_chart() -> None:
    svg = bar_chart(np.array([0.0, 1.0]), np.array([0]), axis="x", count_name="n")
    assert float(bars(svg)[0]["height"]) == 0
    assert "nan" not in rose_chart(np.zeros(8, np.int64), name="n")
    assert "nan" not in grid_chart(
        np.arange(3.0), np.arange(3.0), np.zeros((2, 2), np.int64), x_axis="x", y_axis="y", count_name="n"
    )


def test_areas_of_petals_are_the_counts_and_the_first_points_right() -> None:
    svg = rose_chart(np.array([4, 1, 0, 0]), name="headings")
    petals = re.findall(r"M130\.0,130\.0L([\d.]+),([\d.]+)A([\d.]+),", svg)
    radii = [float(petal[2]) for petal in petals]
    assert radii[0] == pytest.approx(2 * radii[1], abs=0.1)
    x, y = float(petals[1][0]), float(petals[1][1])
    # The second of four bins is centred on +y, which is up: its first corner is to the right of it.
    assert y < 130
    assert x == pytest.approx(130 + radii[1] * math.cos(0.53 * math.pi / 2), abs=0.2)


def test_empty_fields_stay_white_and_full_ones_are_darkest() -> None:
    counts = np.array([[0, 1], [0, 100]])
    svg = grid_chart(np.arange(3.0), np.arange(3.0), counts, x_axis="w", y_axis="v", count_name="Samples")
    fields = bars(svg)
    assert [field["title"] for field in fields] == ["1", "100"]
    assert float(fields[0]["fill-opacity"]) < float(fields[1]["fill-opacity"]) == 1.0
    assert float(fields[1]["y"]) < float(fields[0]["y"])


def test_names_are_escaped() -> None:
    assert "<b>" not in bar_chart(np.array([0.0, 1.0]), np.array([1]), axis="<b>", count_name="<b>")


def test_histograms_look_as_they_did(golden_page: Callable[[str, str], None]) -> None:
    edges, counts = np.array([-0.5, 0.25, 1.0, 1.75]), np.array([7, 0, 3])
    grid = np.array([[0, 1, 5], [12, 0, 2], [0, 3, 0], [1, 1, 0], [0, 0, 9], [2, 0, 0], [0, 7, 0], [1, 0, 0]])
    rest = [("over <2>", 23), ("none", 0), ("never", 4)]
    charts = [
        bar_chart(edges, counts, axis="x [m] & y", count_name="Episodes", rest=rest),
        bar_chart(np.arange(40.0), np.arange(39) % 7, axis="many", count_name="n"),
        bar_chart(np.array([0.0, 1.0]), np.array([0]), axis="none", count_name="n"),
        rose_chart(np.array([9, 4, 1, 0, 16]), name="headings"),
        rose_chart(np.zeros(3, np.int64), name="none"),
        grid_chart(edges, np.arange(9) * 0.3 - 0.6, grid, x_axis="w", y_axis="<v>", count_name="Samples"),
        grid_chart(edges, np.arange(3.0), np.zeros((2, 3), np.int64), x_axis="w", y_axis="v", count_name="n"),
    ]
    golden_page("histograms", "\n\n".join(charts))


def test_bars_stand_on_the_axis_within_the_picture() -> None:
    svg = bar_chart(np.array([0.0, 1.0, 2.0, 3.0]), np.array([4, 0, 1]), axis="x [m]", count_name="Episodes")
    _, _, width, height = map(float, ElementTree.fromstring(svg).attrib["viewBox"].split())
    feet = {round(float(bar["y"]) + float(bar["height"]), 1) for bar in bars(svg)}
    assert len(feet) == 1
    assert 0.5 * height < feet.pop() < height
    assert all(float(bar["y"]) > 0 and float(bar["height"]) >= 0 for bar in bars(svg))
    lefts = [float(bar["x"]) for bar in bars(svg)]
    assert 0 < lefts[0] < lefts[1] < lefts[2] < width
    assert np.diff(lefts) == pytest.approx(lefts[1] - lefts[0], abs=0.2)


def test_petals_stay_in_the_rose_and_the_fullest_reaches_its_rim() -> None:
    svg = rose_chart(np.array([9, 4, 1, 0]), name="headings")
    radii = [float(radius) for radius in re.findall(r"A([\d.]+),", svg)]
    assert radii[1] == pytest.approx(radii[0] * 2 / 3, abs=0.1)
    assert 60 < max(radii) < 130


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
