import re

import numpy as np
import pytest

from readygo.common.errors import ConfigError
from readygo.services.reconstructor.marker_sheet import marker_cells, marker_pdf
from readygo.services.reconstructor.metric.markers import find_markers

MM = 72 / 25.4


def drawn(pdf: bytes, pixels_per_mm: float) -> np.ndarray:
    """The rectangles of a page as an image."""
    width, height = (float(word) / MM for word in re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf).groups())
    image = np.full((round(height * pixels_per_mm), round(width * pixels_per_mm)), 255, np.uint8)
    for words in re.findall(rb"^([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re f", pdf, re.MULTILINE):
        x, y, w, h = (float(word) / MM * pixels_per_mm for word in words)
        image[round(len(image) - y - h) : round(len(image) - y), round(x) : round(x + w)] = 0
    return image


@pytest.mark.parametrize(("dictionary", "marker"), [("4X4_50", 3), ("APRILTAG_36h11", 11)])
def test_printed_marker_is_found_at_its_size(dictionary: str, marker: int) -> None:
    image = drawn(marker_pdf(dictionary, marker, 0.15, "A4"), 4.0)
    ((found, corners_px),) = find_markers(image, dictionary)
    assert found == marker
    sides_px = np.linalg.norm(corners_px - np.roll(corners_px, -1, axis=0), axis=1)
    np.testing.assert_allclose(sides_px / 4.0, 150.0, atol=0.3)


def test_document_is_whole() -> None:
    pdf = marker_pdf("4X4_50", 0, 0.2, "A3")
    place = int(re.search(rb"startxref\n(\d+)", pdf)[1])
    assert pdf[place : place + 4] == b"xref"
    for number, entry in enumerate(re.findall(rb"^(\d{10}) 00000 n", pdf, re.MULTILINE), start=1):
        assert pdf[int(entry) :].startswith(b"%d 0 obj" % number)
    assert b"/PrintScaling /None" in pdf


@pytest.mark.parametrize(
    ("marker", "size_m", "words"), [(50, 0.1, "0 to 49"), (0, 0.2, "0.01 to 0.158"), (0, 0.0, "got 0 m")]
)
def test_what_no_page_holds_is_refused(marker: int, size_m: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        marker_pdf("4X4_50", marker, size_m, "A4")


def test_cells_have_a_black_border() -> None:
    cells = marker_cells("4X4_50", 0)
    assert cells.shape == (6, 6)
    assert cells[[0, -1]].all()
    assert not cells.all()
