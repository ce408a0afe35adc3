"""Maps of a scene's quality: lines of sight out of it, observed parts, errors of held-out images."""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from readygo.apps.health.numbers import Sightlines
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import INK, Rgb, draw_scale_bar, map_window, put_mark
from readygo.common.drawing.sheet import Swatch, line_swatch, sheet
from readygo.common.maps import OccupancyMap
from readygo.common.scenes.filmed import FILMED_MIN
from readygo.common.scenes.top_view import TopView

SIDE_PX, MARGIN_M = 900, 0.5
OUT: Rgb = (213, 94, 0)
# Orange to blue, as maps of sharpness: distinguishable with every common colour vision.
_FILMED: tuple[tuple[float, Rgb, str], ...] = (
    (0.25, (150, 50, 10), "less than 25 % of what is seen was filmed"),
    (FILMED_MIN, (240, 140, 50), f"less than {100 * FILMED_MIN:.0f} %"),
    (0.75, (190, 215, 235), "less than 75 %"),
    (math.inf, (80, 150, 205), "more"),
)
_PSNR: tuple[tuple[float, Rgb, str], ...] = (
    (20.0, (150, 50, 10), "PSNR below 20 dB"),
    (24.0, (240, 140, 50), "below 24 dB"),
    (28.0, (130, 180, 220), "below 28 dB"),
    (math.inf, (40, 110, 170), "better"),
)


def sightlines_map(lines: Sightlines, occupancy: OccupancyMap) -> Picture:
    """The map with the lines of sight that leave the scene."""
    view = _window(occupancy)
    picture = view.rgb.copy()
    reach_m = 0.5 * float(max(view.rgb.shape[:2])) * view.frame.resolution_m
    for place, row in zip(lines.places_m, lines.open, strict=True):
        for bearing in lines.bearings_rad[row]:
            _line(picture, view, place, place + reach_m * np.array([math.cos(bearing), math.sin(bearing)]), OUT)
    for number, place in enumerate(lines.places_m, start=1):
        put_mark(picture, view, place, str(number), INK)
    draw_scale_bar(picture, view)
    words = f"nothing stands in {100 * lines.open_share:.0f} % of the directions"
    return sheet([[picture]], [(words, INK)], [(line_swatch(OUT), "looks out of the scene at the height of eyes")])


def filmed_map(share: npt.NDArray[np.float32], occupancy: OccupancyMap) -> Picture:
    """The map with the ground coloured by the share of the view from there that was filmed."""
    view = _window(OccupancyMap(frame=occupancy.frame, occupied=share <= 0.0))
    picture = view.rgb.copy()
    values = _sampled(view, share, occupancy)
    for limit, colour, _ in reversed(_FILMED):
        picture[(values > 0.0) & (values < limit)] = colour
    draw_scale_bar(picture, view)
    return sheet([[picture]], [("what was filmed", INK)], [(_square(colour), text) for _, colour, text in _FILMED])


def held_out_map(images: Sequence[dict[str, Any]], occupancy: OccupancyMap) -> Picture | None:
    """The map with the places and the quality of held-out images; None if their places are unknown."""
    placed = [row for row in images if row["xyyaw"] is not None]
    if not placed:
        return None
    view = _window(occupancy)
    picture = view.rgb.copy()
    for number, row in enumerate(images, start=1):
        if row["xyyaw"] is None:
            continue
        x, y, yaw = row["xyyaw"]
        colour = next(colour for limit, colour, _ in _PSNR if row["psnr_db"] < limit)
        _line(picture, view, np.array([x, y]), np.array([x + 0.4 * math.cos(yaw), y + 0.4 * math.sin(yaw)]), colour, 3)
        put_mark(picture, view, (x, y), str(number), colour)
    draw_scale_bar(picture, view)
    return sheet([[picture]], [("held-out images", INK)], [(_square(colour), text) for _, colour, text in _PSNR])


def _window(occupancy: OccupancyMap) -> TopView:
    """Top view of the free part of a map."""
    cells, frame = np.argwhere(~occupancy.occupied), occupancy.frame
    if not len(cells):
        cells = np.array([[0, 0], np.array(occupancy.occupied.shape) - 1])
    corner = np.array([frame.origin_x_m, frame.origin_y_m])
    low_m = corner + cells.min(axis=0)[::-1] * frame.resolution_m - MARGIN_M
    high_m = corner + (cells.max(axis=0)[::-1] + 1) * frame.resolution_m + MARGIN_M
    return map_window(occupancy, low_m, high_m, pixel_m=float((high_m - low_m).max()) / SIDE_PX)


def _sampled(view: TopView, values: npt.NDArray[np.float32], occupancy: OccupancyMap) -> npt.NDArray[np.float32]:
    """Values of a grid's cells at the pixels of a picture, 0 beyond the grid."""
    height, width = view.rgb.shape[:2]
    frame, pixel_m = occupancy.frame, view.frame.resolution_m
    x_m = view.frame.origin_x_m + (np.arange(width) + 0.5) * pixel_m
    y_m = view.frame.origin_y_m + (np.arange(height)[::-1] + 0.5) * pixel_m
    padded = np.pad(values, 1)
    j = np.clip(np.floor((x_m - frame.origin_x_m) / frame.resolution_m).astype(np.int64) + 1, 0, padded.shape[1] - 1)
    i = np.clip(np.floor((y_m - frame.origin_y_m) / frame.resolution_m).astype(np.int64) + 1, 0, padded.shape[0] - 1)
    sampled: npt.NDArray[np.float32] = padded[i[:, None], j[None, :]]
    return sampled


def _line(
    picture: Picture,
    view: TopView,
    begin_m: npt.NDArray[np.float64],
    end_m: npt.NDArray[np.float64],
    colour: Rgb,
    width_px: int = 1,
) -> None:
    ends = [tuple(int(value) for value in np.rint(view.world_to_pixel(at) - 0.5)) for at in (begin_m, end_m)]
    cv2.line(picture, ends[0], ends[1], colour, width_px, cv2.LINE_AA)


def _square(colour: Rgb) -> Swatch:
    def draw(picture: Picture, x: int, y: int) -> None:
        cv2.rectangle(picture, (x - 10, y - 6), (x + 10, y + 6), colour, cv2.FILLED)

    return draw
