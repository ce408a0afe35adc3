"""Sheets: pictures side by side below a headline, with a legend."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import WHITE, Rgb

Swatch = Callable[[UInt8Array, int, int], None]
"""Draws an item of the legend into a picture, around the point (x, y)."""

GAP_PX = 10
_WIDTH_MIN_PX = 480
_HEADER_PX = 34
_LEGEND_ROW_PX = 24


def sheet(
    rows: Sequence[Sequence[UInt8Array]], headline: Sequence[tuple[str, Rgb]], legend: Sequence[tuple[Swatch, str]]
) -> UInt8Array:
    """Pictures in rows, below a headline and above a legend.

    Args:
        rows: Pictures side by side, row by row.
        headline: Words with their colours; the first one is set off.
        legend: What stands for what.

    Returns:
        RGB image, shape (H, W, 3).
    """
    width = max(_WIDTH_MIN_PX, max(sum(part.shape[1] + GAP_PX for part in row) - GAP_PX for row in rows)) + 2 * GAP_PX
    parts = [_header(width, headline)]
    for row in rows:
        strip = np.full((max(len(part) for part in row) + GAP_PX, width, 3), WHITE, np.uint8)
        left = GAP_PX
        for part in row:
            strip[: len(part), left : left + part.shape[1]] = part
            left += part.shape[1] + GAP_PX
        parts.append(strip)
    return np.concatenate([*parts, legend_strip(width, legend)])


def stack_panels(panels: Sequence[UInt8Array]) -> UInt8Array:
    """Pictures of one width, one below the other."""
    gap = np.full((GAP_PX, panels[0].shape[1], 3), WHITE, np.uint8)
    return np.concatenate([part for panel in panels for part in (panel, gap)][:-1])


def line_swatch(colour: Rgb, width_px: int = 2) -> Swatch:
    """A line."""

    def draw(picture: UInt8Array, x: int, y: int) -> None:
        cv2.line(picture, (x - 11, y), (x + 11, y), colour, width_px, cv2.LINE_AA)

    return draw


def dotted_swatch(colour: Rgb) -> Swatch:
    """A line with a dot on it."""

    def draw(picture: UInt8Array, x: int, y: int) -> None:
        cv2.line(picture, (x - 11, y), (x + 11, y), colour, 3, cv2.LINE_AA)
        cv2.circle(picture, (x, y), 4, colour, cv2.FILLED, cv2.LINE_AA)

    return draw


def ring_swatch(colour: Rgb, *, filled: bool = True) -> Swatch:
    """A ring, around a dot if it is filled."""

    def draw(picture: UInt8Array, x: int, y: int) -> None:
        cv2.circle(picture, (x, y), 7, colour, 1, cv2.LINE_AA)
        if filled:
            cv2.circle(picture, (x, y), 2, colour, cv2.FILLED, cv2.LINE_AA)

    return draw


def area_swatch(colour: Rgb, share: float) -> Swatch:
    """An area that the map shines through."""
    shade = tuple(round(plan_view.FREE * (1 - share) + value * share) for value in colour)

    def draw(picture: UInt8Array, x: int, y: int) -> None:
        cv2.rectangle(picture, (x - 10, y - 6), (x + 10, y + 6), shade, cv2.FILLED)
        cv2.rectangle(picture, (x - 10, y - 6), (x + 10, y + 6), colour, 1)

    return draw


def _header(width: int, words: Sequence[tuple[str, Rgb]]) -> UInt8Array:
    header = np.full((_HEADER_PX, width, 3), WHITE, np.uint8)
    x = GAP_PX
    for number, (word, colour) in enumerate(words):
        size = 0.6 if number == 0 else 0.45
        length = plan_view.text_width_px(word, size=size)
        if number == 0:
            cv2.rectangle(header, (x, 6), (x + length + 12, _HEADER_PX - 6), colour, cv2.FILLED)
        plan_view.put_text(
            header, word, (x + (6 if number == 0 else 0), 22), size=size, colour=WHITE if number == 0 else colour
        )
        x += length + (30 if number == 0 else 22)
    return header


def legend_strip(width: int, items: Sequence[tuple[Swatch, str]]) -> UInt8Array:
    """A legend in rows, shape (H, `width`, 3)."""
    places, x, row = [], GAP_PX, 0
    for _, text in items:
        length = 32 + plan_view.text_width_px(text) + 18
        if x + length > width and x > GAP_PX:
            x, row = GAP_PX, row + 1
        places.append((x, row))
        x += length
    strip = np.full(((row + 1) * _LEGEND_ROW_PX + 6, width, 3), WHITE, np.uint8)
    for (draw, text), (left, line) in zip(items, places, strict=True):
        y = line * _LEGEND_ROW_PX + _LEGEND_ROW_PX // 2
        draw(strip, left + 12, y)
        plan_view.put_text(strip, text, (left + 30, y + 5))
    return strip
