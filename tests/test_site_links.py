from pathlib import Path

from tests.site_links import broken_links


def test_links_to_nothing_and_to_no_anchor_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<h1 id="top"></h1><a href="b.html#there"></a><a href="#top"></a><a href="https://example.org/x"></a>'
        '<a href="b.html#gone"></a><img src="none.png">'
    )
    (tmp_path / "b.html").write_text('<p id="there"></p><a href="./a.html"></a>')
    assert broken_links(tmp_path) == ["a.html: b.html#gone", "a.html: none.png"]
