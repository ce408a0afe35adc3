import base64
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.report.page import (
    ColourLegend,
    CommandLine,
    Details,
    Estimate,
    MediaFigure,
    Meter,
    PageLink,
    PageTable,
    Paragraph,
    RateRow,
    StripImage,
    Subheading,
    arrange_blocks,
    drawing,
    film,
    image_strip,
    page,
    percent,
    photograph,
    rejections,
)
from tests.apps.report.drawn import html_of


def test_page_shows_its_parts_in_order_and_leaves_empty_ones_out() -> None:
    sections = {"One": [Paragraph(text="1")], "None": [], "Two": [Paragraph(text="2")]}
    html = page("T", "S", tiles=[("7", "episodes")], sections=sections, facts={})
    texts = ("<h1>T</h1>", "<p>S</p>", "<b>7</b>episodes", "<h2>One</h2>", "<p>1</p>", "<h2>Two</h2>")
    places = [html.index(text) for text in texts]
    assert places == sorted(places)
    assert "None" not in html
    assert "<footer" not in html
    assert '<ul class="tiles">' not in page("T", "S", tiles=[], sections={}, facts={})


def test_page_has_a_dark_theme_and_fetches_nothing() -> None:
    html = page("T", "S", tiles=[], sections={}, facts={})
    assert "prefers-color-scheme: dark" in html
    assert not any(word in html for word in ("http", "<script", "<link", "@import", "url("))


def test_text_of_pages_and_blocks_is_escaped() -> None:
    blocks = [
        Paragraph(text="<p1>", links=[PageLink(href='a "b".html', what="<p2>")]),
        Subheading("<s>"),
        PageTable(("<c1>", "<c2>"), [["<c3>", Estimate("<c4>", "<c5>")]]),
        RateRow(name="<r>", meter=Meter(0.5)),
        MediaFigure(image='x" onerror="', caption="<f1>", alt='"<f2>'),
        ColourLegend([("<l>", (1, 2, 3))]),
        Details(summary="<d1>", block=CommandLine(line="<d2>", what="<d3>")),
    ]
    html = page("<T>", "<S>", tiles=[("<1>", "<n>")], sections={"<H>": blocks}, facts={"<k>": "<v>"}, hero=blocks[0])
    names = [
        "T",
        "S",
        "1",
        "n",
        "H",
        "k",
        "v",
        "p1",
        "p2",
        "s",
        "c1",
        "c2",
        "c3",
        "c4",
        "c5",
        "r",
        "f1",
        "f2",
        "l",
        "d1",
        "d2",
        "d3",
    ]
    assert not [name for name in names if f"<{name}>" in html]
    assert all(f"&lt;{name}&gt;" in html for name in names)
    assert 'onerror="' not in html
    assert 'href="a%20%22b%22.html"' in html


def test_pictures_lie_within_the_page(tmp_path: Path) -> None:
    rgb = np.zeros((16, 24, 3), np.uint8)
    rgb[..., 0] = 200
    for figure, kind in ((drawing(rgb, "c"), "png"), (photograph(rgb, "c"), "jpeg")):
        head, data = figure.image.split(",")
        assert head == f"data:image/{kind};base64"
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        assert np.abs(shown.astype(int) - rgb).max() < 8
    (tmp_path / "a.webm").write_bytes(b"RIFF")
    html = html_of([film(tmp_path / "a.webm", "<c>", plays=True)])
    assert 'src="data:video/webm;base64,UklGRg=="' in html
    assert "autoplay" in html
    assert "&lt;c&gt;" in html
    assert "autoplay" not in html_of([film(tmp_path / "a.webm", "")])


def test_cells_of_a_table_name_their_columns_and_empty_ones_are_empty() -> None:
    html = html_of([PageTable(("Driver", "Success"), [["policy", Estimate("5 %")], ["expert", ""]])])
    assert '<th>Driver</th>\n<th class="n">Success</th>' in html
    assert '<td data-name="Driver">policy</td>\n<td class="n" data-name="Success"><span><b>5 %</b></span></td>' in html
    assert '<td class="n" data-name="Success"></td>' in html
    assert html.count("<tr>") == 3


def test_meter_puts_the_interval_on_the_bar() -> None:
    html = html_of([Meter(0.5, (0.25, 0.65))])
    assert '<i style="width:50.0%"></i><u style="left:25.0%;right:35.0%"></u>' in html
    assert '<i style="width:100.0%"></i></div>' in html_of([Meter(1.4)])


def test_rejections_are_sorted_and_counted() -> None:
    table = rejections({"no_<way>": 1, "too late": 3}, 6)
    assert table.columns[0] == "Not recorded, of 10 tried"
    assert table.rows == [["too late", "3", "30 %"], ["no <way>", "1", "10 %"]]
    assert rejections({}, 6).rows == [["none", "0", "0 %"]]


def test_arrangement_has_the_blocks_that_there_are() -> None:
    (pair,) = arrange_blocks("pair", [None, Paragraph(text="a")])
    assert html_of([pair]).replace("\n", "") == '<div class="pair"><p>a</p></div>'
    assert arrange_blocks("pair", [None]) == []
    assert html_of(image_strip([StripImage(time_s=1.5, rgb=np.zeros((2, 2, 3), np.uint8))])).count("1.50 s") == 2


def test_rates_are_whole_percents() -> None:
    assert [percent(rate) for rate in (0.0, 0.504, 1.0)] == ["0 %", "50 %", "100 %"]


def test_page_looks_as_it_did(golden_page: Callable[[str, str], None], tmp_path: Path) -> None:
    (tmp_path / "a.webm").write_bytes(b"RIFF")
    columns = ("<Driver>", "Success", "Why")
    blocks = [
        PageTable(columns, [["me", Estimate("5", "4 to 6"), "x"], ["", Meter(0.3, (0.12, 0.71)), "y"]]),
        rejections({"no_<way>": 1, "b": 3, "a": 3, "too late": 1203}, 1006),
        Details(summary="<s>", block=Paragraph(text="1", is_note=True)),
        ColourLegend([("<n>", (1, 2, 3)), ("m", (40, 50, 60))]),
        MediaFigure(image="x.png", caption="a & b", alt='"c"'),
        film(tmp_path / "a.webm", "<c>", plays=True),
        *arrange_blocks("stack", [film(tmp_path / "a.webm", "d"), MediaFigure(video="films/b.webm", caption="")]),
        RateRow(name="<r>", meter=Meter(-0.1, (-0.2, 1.4)), stands_out=True),
        CommandLine(line="echo <1>", what="say"),
    ]
    links = [PageLink(href="a.html", what="a"), PageLink(href="b.html", what="b")]
    sections = {
        "One": blocks,
        "None": [],
        "<Two>": [Paragraph(text="See:", links=links), Paragraph(text="", links=links)],
    }
    html = page("<T>", "a & b", hero=Subheading("h"), tiles=[("<1>", "<n>")], sections=sections, facts={"<k>": "<v>"})
    golden_page("page", html)


@pytest.mark.parametrize(("count", "dense"), [(7, False), (8, True)])
def test_tables_of_many_columns_are_dense(count: int, dense: bool) -> None:
    columns = [f"c{k}" for k in range(count)]
    assert ('<table class="dense">' in PageTable(columns, [columns]).__html__()) is dense
