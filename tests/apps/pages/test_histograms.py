"""Histograms as SVG: bars, fields and petals stand for the counts."""

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.pages.histograms import bar_chart, grid_chart, rose_chart


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
