"""The robot's sample views as pictures: one sheet, and the map coloured by their sharpness."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from readygo.apps.views.views import Place, SceneViews
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import (
    INK,
    WHITE,
    Rgb,
    draw_scale_bar,
    map_window,
    put_mark,
    put_text,
    text_width_px,
)
from readygo.common.drawing.sheet import Swatch, ring_swatch, sheet
from readygo.common.images.clarity import SHARP_FROM
from readygo.common.maps import OccupancyMap, clearance_m, free_components
from readygo.common.scenes.top_view import TopView

COLUMNS, TILE_WIDTH_PX, CAPTION_PX = 6, 256, 20
MAP_SIDE_PX, MARGIN_M = 1000, 0.5
ALARM: Rgb = (176, 58, 0)
# Orange to blue: distinguishable with every common colour vision, and by lightness around the limit.
_STEPS: tuple[tuple[float, Rgb, str], ...] = (
    (SHARP_FROM / 5, (150, 50, 10), f"sharpness below {SHARP_FROM / 5:g}"),
    (SHARP_FROM, (240, 140, 50), f"below {SHARP_FROM:g}: fog"),
    (2 * SHARP_FROM, (190, 215, 235), f"below {2 * SHARP_FROM:g}"),
    (math.inf, (80, 150, 205), "sharper"),
)


def sharpness_colour(sharpness: float) -> Rgb:
    """Colour of a sharpness on maps."""
    return next(colour for limit, colour, _ in _STEPS if sharpness < limit)


def sharpness_legend() -> list[tuple[Swatch, str]]:
    """The legend of the colours."""
    return [(_swatch(colour), text) for _, colour, text in _STEPS]


def views_sheet(views: SceneViews, name: str) -> Picture:
    """The typical view from each place, with number, place, sharpness and coverage below it.

    Args:
        views: Sample views of the scene.
        name: Name of the scene.

    Returns:
        RGB image of the sheet.
    """
    tiles = [_tile(number, place) for number, place in enumerate(views.places, start=1)]
    rows = [tiles[k : k + COLUMNS] for k in range(0, len(tiles), COLUMNS)]
    headline = [
        (f"what the robot sees in {name}", INK),
        (
            f"sharpness {views.sharpness:.0f}, {views.blurred} of {len(tiles)} places blurred",
            ALARM if views.blurred else INK,
        ),
        (f"surface {100 * views.coverage:.0f} % of the view, {views.bare} places bare", ALARM if views.bare else INK),
    ]
    note = "number on the map, x and y [m], sharpness, share of the view that is surface"
    return sheet(rows, headline, [(_swatch(INK), note), (_swatch(ALARM), "too little to learn from")])


def clarity_map(views: SceneViews, occupancy: OccupancyMap, radius_m: float) -> Picture:
    """The map, its reachable ground in the colour of the nearest place's sharpness; numbers are those of the sheet.

    Args:
        views: Sample views of the scene.
        occupancy: Map of the cells that block the robot.
        radius_m: Radius of the disc that the reachable ground is for [m].

    Returns:
        RGB image of the map.
    """
    labels, _ = free_components(clearance_m(occupancy) > radius_m)
    view = _window(occupancy, labels == 1)
    picture = view.rgb.copy()
    xy_m = np.array([place.typical.xyyaw[:2] for place in views.places])
    colours = np.array([sharpness_colour(place.typical.sharpness) for place in views.places], dtype=np.uint8)
    u, v, cells = _pixels_of(view, occupancy, labels == 1)
    picture[cells] = colours[_nearest(u, v, view.world_to_pixel(xy_m))]
    draw_scale_bar(picture, view)
    for number, place in enumerate(views.places, start=1):
        put_mark(picture, view, place.typical.xyyaw[:2], str(number), ALARM if place.blurred or place.bare else INK)
    numbers = (ring_swatch(ALARM), "number: too little to learn from")
    return sheet([[picture]], [("sharpness of what the robot sees", INK)], [*sharpness_legend(), numbers])


def _nearest(
    u: npt.NDArray[np.float64], v: npt.NDArray[np.float64], places_px: npt.NDArray[np.float64]
) -> npt.NDArray[np.intp]:
    """Number of the nearest place for each pixel, shape (N,)."""
    owner, least = np.zeros(len(u), np.intp), np.full(len(u), np.inf)
    for number, (x, y) in enumerate(places_px.tolist()):
        squared = (u - x) ** 2 + (v - y) ** 2
        closer = squared < least
        owner[closer], least[closer] = number, squared[closer]
    return owner


def _window(occupancy: OccupancyMap, shown: npt.NDArray[np.bool_]) -> TopView:
    cells, frame = np.argwhere(shown), occupancy.frame
    corner = np.array([frame.origin_x_m, frame.origin_y_m])
    low_m = corner + cells.min(axis=0)[::-1] * frame.resolution_m - MARGIN_M
    high_m = corner + (cells.max(axis=0)[::-1] + 1) * frame.resolution_m + MARGIN_M
    return map_window(occupancy, low_m, high_m, pixel_m=float((high_m - low_m).max()) / MAP_SIDE_PX)


def _pixels_of(
    view: TopView, occupancy: OccupancyMap, shown: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Columns and rows of the pixels that lie on shown cells, and which those are, shape (H, W)."""
    height, width = view.rgb.shape[:2]
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x_m = view.frame.origin_x_m + u * view.frame.resolution_m
    y_m = view.frame.origin_y_m + (height - v) * view.frame.resolution_m
    frame, padded = occupancy.frame, np.pad(shown, 1)
    j = np.clip(np.floor((x_m - frame.origin_x_m) / frame.resolution_m).astype(np.int64) + 1, 0, padded.shape[1] - 1)
    i = np.clip(np.floor((y_m - frame.origin_y_m) / frame.resolution_m).astype(np.int64) + 1, 0, padded.shape[0] - 1)
    cells = padded[i, j]
    return u[cells], v[cells], cells


def captioned(rgb: Picture, text: str, colour: Rgb = INK) -> Picture:
    """A picture at the size of a thumbnail, with a line of text below it."""
    height, width = rgb.shape[:2]
    size = (TILE_WIDTH_PX, round(height * TILE_WIDTH_PX / width))
    method = cv2.INTER_AREA if width > TILE_WIDTH_PX else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(rgb, size, interpolation=method), dtype=np.uint8)
    caption = np.full((CAPTION_PX, TILE_WIDTH_PX, 3), WHITE, np.uint8)
    size_of_text = next((s for s in (0.4, 0.38, 0.36, 0.34) if text_width_px(text, size=s) < TILE_WIDTH_PX - 6), 0.32)
    put_text(caption, text, (2, 14), size=size_of_text, colour=colour)
    return np.concatenate([image, caption])


def _tile(number: int, place: Place) -> Picture:
    look = place.typical
    x_m, y_m, _ = look.xyyaw
    text = f"{number}  ({x_m:.1f}, {y_m:.1f})  sharp {look.sharpness:.0f}  surface {100 * look.coverage:.0f} %"
    return captioned(look.rgb, text, ALARM if place.blurred or place.bare else INK)


def _swatch(colour: Rgb) -> Swatch:
    def draw(picture: Picture, x: int, y: int) -> None:
        cv2.rectangle(picture, (x - 10, y - 6), (x + 10, y + 6), colour, cv2.FILLED)

    return draw
