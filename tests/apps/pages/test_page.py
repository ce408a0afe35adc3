import base64
from pathlib import Path

import cv2
import numpy as np

from readygo.apps.pages.page import figure, jpeg_source, page, percent, png_source, table, webp_source


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
    (tmp_path / "a.webp").write_bytes(b"RIFF")
    assert webp_source(tmp_path / "a.webp") == "data:image/webp;base64,UklGRg=="


def test_tables_and_rates() -> None:
    assert table("<tr>h</tr>", "<tr>r</tr>").count("<tr>") == 2
    assert [percent(rate) for rate in (0.0, 0.504, 1.0)] == ["0 %", "50 %", "100 %"]
