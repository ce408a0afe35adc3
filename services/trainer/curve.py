"""The loss curve as a picture."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole

WIDTH_PX, HEIGHT_PX = 960, 540
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 90, 30, 50, 60
COLOURS_BGR = ((180, 105, 30), (30, 60, 200), (60, 140, 40), (130, 60, 140))
INK_BGR, GRID_BGR = (60, 60, 60), (225, 225, 225)

Image = npt.NDArray[np.uint8]


def draw_curves(path: Path, curves: dict[str, Sequence[tuple[float, float]]], *, title: str, x_label: str) -> None:
    """Draw named curves on a logarithmic y axis into a PNG file.

    Args:
        path: File to write, in one piece.
        curves: Points (x, y > 0) of each curve; empty ones are left out.
        title: Line above the plot.
        x_label: What x is, with its unit.
    """
    shown = {name: [(x, y) for x, y in points if y > 0 and math.isfinite(y)] for name, points in curves.items()}
    shown = {name: points for name, points in shown.items() if points}
    canvas = np.full((HEIGHT_PX, WIDTH_PX, 3), 255, np.uint8)
    _text(canvas, title, (LEFT_PX, TOP_PX - 20))
    if shown:
        x_max = max(x for points in shown.values() for x, _ in points) or 1.0
        ys = [y for points in shown.values() for _, y in points]
        low, high = math.log10(min(ys)) - 0.05, math.log10(max(ys)) + 0.05
        _draw_axes(canvas, x_max, low, high, x_label)
        for i, (name, points) in enumerate(shown.items()):
            colour = COLOURS_BGR[i % len(COLOURS_BGR)]
            pixels = [_pixel(x / x_max, (math.log10(y) - low) / (high - low)) for x, y in points]
            cv2.polylines(canvas, [np.array(pixels, np.int32)], False, colour, 2, cv2.LINE_AA)
            _text(canvas, name, (WIDTH_PX - 260, TOP_PX + 24 * (i + 1)), colour)
    # Encoded in memory: OpenCV says nothing of a full disk.
    write_whole(path, cv2.imencode(path.suffix, canvas)[1].tobytes(), raises=PolicyError)


def draw_history(path: Path, history: Sequence[dict[str, Any]]) -> None:
    """Training and validation loss over time, from the records of the training loop."""
    draw_curves(
        path,
        {
            "training loss": [(item["samples"], item["train_loss"]) for item in history],
            "validation loss": [(item["samples"], item["validation_loss"]) for item in history],
        },
        title="Mean squared error, in units of the robot's limits",
        x_label="training samples seen",
    )


def _draw_axes(canvas: Image, x_max: float, low: float, high: float, x_label: str) -> None:
    steps = (1, 2, 5) if high - low < 2 else (1,)
    for exponent in range(math.floor(low), math.ceil(high) + 1):
        for step in steps:
            value = math.log10(step) + exponent
            if low <= value <= high:
                y_px = _pixel(0.0, (value - low) / (high - low))[1]
                cv2.line(canvas, (LEFT_PX, y_px), (WIDTH_PX - RIGHT_PX, y_px), GRID_BGR, 1)
                _text(canvas, f"{10**value:.2g}", (20, y_px + 5))
    for i in range(5):
        x_px = _pixel(i / 4, 0.0)[0]
        _text(canvas, f"{x_max * i / 4:.3g}", (x_px - 20, HEIGHT_PX - BOTTOM_PX + 24))
    corners = (LEFT_PX, TOP_PX), (WIDTH_PX - RIGHT_PX, HEIGHT_PX - BOTTOM_PX)
    cv2.rectangle(canvas, *corners, INK_BGR, 1)
    _text(canvas, x_label, (WIDTH_PX // 2 - 80, HEIGHT_PX - 12))


def _pixel(x: float, y: float) -> tuple[int, int]:
    """Pixel of a point given in fractions of the plot, y upwards."""
    return (
        round(LEFT_PX + x * (WIDTH_PX - LEFT_PX - RIGHT_PX)),
        round(HEIGHT_PX - BOTTOM_PX - y * (HEIGHT_PX - TOP_PX - BOTTOM_PX)),
    )


def _text(canvas: Image, text: str, at_px: tuple[int, int], colour: tuple[int, int, int] = INK_BGR) -> None:
    cv2.putText(canvas, text, at_px, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
