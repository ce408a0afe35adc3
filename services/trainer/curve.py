"""The loss curve as a picture."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.drawing.ticks import log_ticks, nice_ticks, number_text
from readygo.common.errors import PolicyError
from readygo.common.files import write_whole

WIDTH_PX, HEIGHT_PX = 960, 540
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 90, 40, 84, 64
COLOURS_BGR = ((180, 105, 30), (30, 60, 200), (60, 140, 40), (130, 60, 140))
INK_BGR, GRID_BGR = (60, 60, 60), (225, 225, 225)
LEGEND_PX = 260
DOTS_MAX = 30
"""Curves of so few points have a dot at each: a single one would not be seen."""

Image = npt.NDArray[np.uint8]


def draw_curves(path: Path, curves: dict[str, Sequence[tuple[float, float]]], *, title: str, x_label: str) -> None:
    """Draw named curves on a logarithmic y axis into a PNG file.

    Args:
        path: File to write, in one piece.
        curves: Points (x >= 0, y > 0) of each curve; empty ones are left out.
        title: Line above the plot.
        x_label: What x is, with its unit.
    """
    shown = {name: [(x, y) for x, y in points if y > 0 and math.isfinite(y)] for name, points in curves.items()}
    shown = {name: points for name, points in shown.items() if points}
    canvas = np.full((HEIGHT_PX, WIDTH_PX, 3), 255, np.uint8)
    _text(canvas, title, (LEFT_PX, 28))
    if shown:
        x_max = max(x for points in shown.values() for x, _ in points) or 1.0
        ys = [y for points in shown.values() for _, y in points]
        y_ticks = log_ticks(min(ys), max(ys))
        _draw_axes(canvas, x_max, y_ticks, x_label)
        for number, (name, points) in enumerate(shown.items()):
            pixels = [_pixel(x / x_max, _height(y, y_ticks)) for x, y in points]
            _draw_curve(canvas, name, pixels, number)
    # Encoded in memory: OpenCV says nothing of a full disk.
    write_whole(path, cv2.imencode(path.suffix, canvas)[1].tobytes(), raises=PolicyError)


def draw_history(path: Path, history: Sequence[dict[str, Any]]) -> None:
    """What training makes small and the error on what is held out, from the records of the training loop."""
    draw_curves(
        path,
        {
            "training": [(item["samples"], item["train_loss"]) for item in history],
            "held out": [(item["samples"], item["validation_loss"]) for item in history],
        },
        title="Loss of training, and squared error on what is held out in units of the limits; logarithmic",
        x_label="samples learned from",
    )


def _draw_curve(canvas: Image, name: str, pixels: list[tuple[int, int]], number: int) -> None:
    """A curve, and its entry of the legend above the plot."""
    colour = COLOURS_BGR[number % len(COLOURS_BGR)]
    cv2.polylines(canvas, [np.array(pixels, np.int32)], False, colour, 2, cv2.LINE_AA)
    if len(pixels) <= DOTS_MAX:
        for pixel in pixels:
            cv2.circle(canvas, pixel, 4, colour, cv2.FILLED, cv2.LINE_AA)
    left = LEFT_PX + LEGEND_PX * number
    cv2.line(canvas, (left, 55), (left + 24, 55), colour, 3, cv2.LINE_AA)
    _text(canvas, name, (left + 34, 60), colour)


def _draw_axes(canvas: Image, x_max: float, y_ticks: Sequence[float], x_label: str) -> None:
    for tick in y_ticks:
        left, y_px = _pixel(0.0, _height(tick, y_ticks))
        cv2.line(canvas, (left, y_px), (WIDTH_PX - RIGHT_PX, y_px), GRID_BGR, 1)
        _text(canvas, number_text(tick), (left - 10, y_px + 5), align=1.0)
    for tick in nice_ticks(0.0, x_max):
        if tick <= x_max:
            x_px, bottom = _pixel(tick / x_max, 0.0)
            _text(canvas, number_text(tick), (x_px, bottom + 24), align=0.5)
    corners = (LEFT_PX, TOP_PX), (WIDTH_PX - RIGHT_PX, HEIGHT_PX - BOTTOM_PX)
    cv2.rectangle(canvas, *corners, INK_BGR, 1)
    _text(canvas, x_label, ((LEFT_PX + WIDTH_PX - RIGHT_PX) // 2, HEIGHT_PX - 12), align=0.5)


def _height(y: float, y_ticks: Sequence[float]) -> float:
    """Where a value is between the first and the last tick, as a fraction."""
    low, high = math.log10(y_ticks[0]), math.log10(y_ticks[-1])
    return (math.log10(y) - low) / (high - low)


def _pixel(x: float, y: float) -> tuple[int, int]:
    """Pixel of a point given in fractions of the plot, y upwards."""
    return (
        round(LEFT_PX + x * (WIDTH_PX - LEFT_PX - RIGHT_PX)),
        round(HEIGHT_PX - BOTTOM_PX - y * (HEIGHT_PX - TOP_PX - BOTTOM_PX)),
    )


def _text(
    canvas: Image,
    text: str,
    at_px: tuple[int, int],
    colour: tuple[int, int, int] = INK_BGR,
    *,
    align: float = 0.0,
) -> None:
    """A line of text; `align` says how much of it is left of its place."""
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    place = (at_px[0] - round(align * width), at_px[1])
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
