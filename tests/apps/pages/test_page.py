import base64
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from readygo.apps.pages.page import (
    Column,
    details,
    figure,
    film_figure,
    jpeg_source,
    legend,
    page,
    percent,
    png_source,
    rejections,
    table,
)


def test_page_shows_its_parts_in_order_and_leaves_empty_ones_out() -> None:
    html = page(
        "T", "S", tiles=[("7", "episodes")], sections=[("One", "<p>1</p>"), ("None", ""), ("Two", "<p>2</p>")], facts={}
    )
    places = [
        html.index(text) for text in ("<h1>T</h1>", "<p>S</p>", "<b>7</b>episodes", "<h2>One</h2><p>1</p>", "Two")
    ]
    assert places == sorted(places)
    assert "None" not in html
    assert "<footer" not in html
    assert '<ul class="tiles">' not in page("T", "S", tiles=[], sections=[], facts={})


def test_text_is_escaped_and_bodies_are_html() -> None:
    html = page("<T>", "a & b", tiles=[("<1>", "<n>")], sections=[("<H>", "<i>x</i>")], facts={"<k>": "<v>"})
    for wrong in ("<T>", "<1>", "<n>", "<H>", "<k>", "<v>", "a & b"):
        assert wrong not in html
    assert "<i>x</i>" in html
    assert "<dt>&lt;k&gt;</dt><dd>&lt;v&gt;</dd>" in html
    assert 'alt="a &quot;b&quot;"' in figure("x", "caption", alt='a "b"')


def test_pictures_lie_within_the_page(tmp_path: Path) -> None:
    rgb = np.zeros((16, 24, 3), np.uint8)
    rgb[..., 0] = 200
    for source, kind in ((png_source(rgb), "png"), (jpeg_source(rgb), "jpeg")):
        head, data = source.split(",")
        assert head == f"data:image/{kind};base64"
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        assert np.abs(shown.astype(int) - rgb).max() < 8
    (tmp_path / "a.webm").write_bytes(b"RIFF")
    film = film_figure(tmp_path / "a.webm", "<c>", runs=True)
    assert 'src="data:video/webm;base64,UklGRg=="' in film
    assert "autoplay" in film
    assert "&lt;c&gt;" in film
    assert "autoplay" not in film_figure(tmp_path / "a.webm", "")


def test_cells_of_a_table_name_their_columns() -> None:
    html = table([Column("<Driver>"), Column("Success", "n")], [["policy", "<b>5 %</b>"], ["expert", ""]])
    assert "<th>&lt;Driver&gt;</th><th class=n>Success</th>" in html
    assert '<td data-name="&lt;Driver&gt;">policy</td><td class=n data-name="Success"><b>5 %</b></td>' in html
    assert html.count("<tr>") == 3


def test_rejections_are_sorted_and_counted() -> None:
    html = rejections({"no_<way>": 1, "too late": 3}, 6)
    assert "Not recorded, of 10 tried" in html
    assert html.index("too late") < html.index("no &lt;way&gt;")
    assert "30 %" in html
    assert ">none<" in rejections({}, 6)


def test_details_legends_and_rates() -> None:
    assert details("<s>", "<p>1</p>") == "<details><summary>&lt;s&gt;</summary><p>1</p></details>"
    assert "rgb(1,2,3)" in legend([("<n>", (1, 2, 3))])
    assert [percent(rate) for rate in (0.0, 0.504, 1.0)] == ["0 %", "50 %", "100 %"]


def test_page_looks_as_it_did(golden_page: Callable[[str, str], None], tmp_path: Path) -> None:
    (tmp_path / "a.webm").write_bytes(b"RIFF")
    cells = table(
        [Column("<Driver>"), Column("Success", "n"), Column("Why", "wide")], [["me", "<b>5</b>", "x"], ["", "", "y"]]
    )
    body = "".join(
        [
            cells,
            rejections({"no_<way>": 1, "b": 3, "a": 3, "too late": 1203}, 1006),
            details("<s>", "<p>1</p>"),
            legend([("<n>", (1, 2, 3)), ("m", (40, 50, 60))]),
            figure("x.png", "a & b", alt='"c"'),
            film_figure(tmp_path / "a.webm", "<c>", runs=True),
            film_figure(tmp_path / "a.webm", "d"),
        ]
    )
    sections = [("One", body), ("None", ""), ("<Two>", "2")]
    html = page("<T>", "a & b", hero="<i>h</i>", tiles=[("<1>", "<n>")], sections=sections, facts={"<k>": "<v>"})
    golden_page("page", html)
