"""A printable sheet with one marker at true size, and its PDF."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.errors import ConfigError
from readygo.services.reconstructor.metric.markers import open_dictionary

_POINTS_PER_M = 72.0 / 0.0254
"""PDF's unit is 1/72 inch."""
PAGES_M = {"A4": (0.210, 0.297), "A3": (0.297, 0.420), "A2": (0.420, 0.594), "letter": (0.2159, 0.2794)}
"""Widths and heights [m]."""
_TEXT_M = 0.03
"""Room for text and ruler below the marker [m]."""
_RULER_M = 0.1


def marker_cells(dictionary: str, marker: int) -> BoolArray:
    """Black cells of a marker with its border, row 0 on top.

    Raises:
        ConfigError: If the dictionary is unknown, or has no such marker.
    """
    import cv2

    book = open_dictionary(dictionary)
    count = len(book.bytesList)
    if not 0 <= marker < count:
        raise ConfigError(f"{dictionary} has the markers 0 to {count - 1}, got {marker}.")
    side = int(book.markerSize) + 2
    return np.asarray(cv2.aruco.generateImageMarker(book, marker, side)) < 128


@dataclass(frozen=True, kw_only=True, eq=False)
class PrintedSheet:
    """A printed page: white, with black rectangles."""

    width_m: float
    height_m: float
    black_m: Float64Array
    """Rectangles: x, y of the lower left corner from that of the page, width, height [m], shape (N, 4)."""
    corners_m: Float64Array
    """The marker's corners on the page: upper left, upper right, lower right, lower left, shape (4, 2) [m]."""


def draw_marker_sheet(dictionary: str, marker: int, size_m: float, page: str) -> PrintedSheet:
    """Black parts of a page with a marker.

    Args:
        dictionary: As OpenCV names it.
        marker: Its id.
        size_m: Side of the black square [m].
        page: A key of `PAGES_M`.

    Raises:
        ConfigError: If it does not fit the page with a white border of a cell, or there is no such marker.
    """
    cells = marker_cells(dictionary, marker)
    width_m, height_m = PAGES_M[page]
    cell_m = size_m / len(cells)
    quiet_m = size_m + 2.0 * cell_m
    if not size_m >= 0.01 or quiet_m > width_m or quiet_m + _TEXT_M > height_m:
        fits_m = min(width_m, height_m - _TEXT_M) / (1.0 + 2.0 / len(cells))
        raise ConfigError(f"On {page} a marker of this dictionary is 0.01 to {fits_m:.3f} m wide, got {size_m:g} m.")
    left_m, bottom_m = (width_m - size_m) / 2.0, (height_m + _TEXT_M - size_m) / 2.0
    black = []
    for row, column in np.argwhere(cells):
        # Cells overlap a little: printers show the seams.
        right = 1.02 if column + 1 < len(cells) and cells[row, column + 1] else 1.0
        black.append((left_m + column * cell_m, bottom_m + (len(cells) - 1 - row) * cell_m, right * cell_m, cell_m))
    black += _ruler((width_m - _RULER_M) / 2.0, 0.020)
    right_m, top_m = left_m + size_m, bottom_m + size_m
    corners_m = np.array([(left_m, top_m), (right_m, top_m), (right_m, bottom_m), (left_m, bottom_m)])
    return PrintedSheet(width_m=width_m, height_m=height_m, black_m=np.array(black), corners_m=corners_m)


def marker_pdf(dictionary: str, marker: int, size_m: float, page: str) -> bytes:
    """The page of `draw_marker_sheet` as PDF, cut out by rectangles, so that it is as large as it says.

    Raises:
        ConfigError: See there.
    """
    sheet = draw_marker_sheet(dictionary, marker, size_m, page)
    lines = ["0 g", *(f"{' '.join(_pt(value) for value in rectangle)} re f" for rectangle in sheet.black_m.tolist())]
    words = (
        f"readygo marker {marker} of {dictionary}: black square {1000 * size_m:g} mm wide. Print at 100 %, measure it."
    )
    lines += ["BT", "/F 8 Tf", f"{_pt((sheet.width_m - _RULER_M) / 2.0)} {_pt(0.012)} Td", f"({words}) Tj", "ET"]
    return _document(sheet.width_m, sheet.height_m, "\n".join(lines))


def _pt(length_m: float) -> str:
    return f"{length_m * _POINTS_PER_M:.4f}"


def _ruler(x_m: float, y_m: float) -> list[tuple[float, float, float, float]]:
    """A line of 100 mm with marks each 10 mm, to see whether the printer kept the size."""
    marks = [(x_m + 0.01 * number - 0.00015, y_m, 0.0003, 0.003) for number in range(11)]
    return [(x_m, y_m, _RULER_M, 0.0003), *marks]


def _document(width_m: float, height_m: float, content: str) -> bytes:
    """A PDF of one page."""
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {_pt(width_m)} {_pt(height_m)}] /Contents 4 0 R "
        "/Resources << /Font << /F 5 0 R >> >> >>",
        f"<< /Length {len(content)} >>\nstream\n{content}\nendstream",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    text, places = "%PDF-1.4\n", []
    for number, body in enumerate(objects, start=1):
        places.append(len(text))
        text += f"{number} 0 obj\n{body}\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    end = f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(text)}\n%%EOF\n"
    return (text + f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}{end}").encode("ascii")
