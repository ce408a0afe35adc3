"""The robot's sample views as pictures: one sheet, and the map coloured by their sharpness."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from readygo.apps.views.views import SceneViews, ViewPlace
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing.plan_view import (
    INK,
    WHITE,
    Rgb,
    draw_scale_bar,
    put_mark,
    put_text,
    sample_grid,
    text_width_px,
    window_around,
)
from readygo.common.drawing.sheet import Swatch, area_swatch, ring_swatch, sheet
from readygo.common.images.clarity import SHARP_FROM
from readygo.common.maps import OccupancyMap, clearance_m, free_components

COLUMNS, TILE_WIDTH_PX, CAPTION_PX = 6, 256, 20
MAP_SIDE_PX = 1000
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
    return [(area_swatch(colour, 1.0), text) for _, colour, text in _STEPS]


def views_sheet(views: SceneViews, name: str) -> UInt8Array:
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
    return sheet(rows, headline, [(area_swatch(INK, 1.0), note), (area_swatch(ALARM, 1.0), "too little to learn from")])


def clarity_map(views: SceneViews, occupancy: OccupancyMap, radius_m: float) -> UInt8Array:
    """The map, its reachable ground in the colour of the nearest place's sharpness; numbers are those of the sheet.

    Args:
        views: Sample views of the scene.
        occupancy: Map of the cells that block the robot.
        radius_m: Radius of the disc that the reachable ground is for [m].

    Returns:
        RGB image of the map.
    """
    labels, _ = free_components(clearance_m(occupancy) > radius_m)
    view = window_around(occupancy, labels == 1, side_px=MAP_SIDE_PX)
    picture = view.rgb.copy()
    xy_m = np.array([place.typical.xyyaw[:2] for place in views.places])
    colours = np.array([sharpness_colour(place.typical.sharpness) for place in views.places], dtype=np.uint8)
    shown = sample_grid(view, labels == 1, occupancy.frame)
    rows, columns = np.nonzero(shown)
    picture[shown] = colours[_nearest(columns, rows, view.world_to_pixel(xy_m))]
    draw_scale_bar(picture, view)
    for number, place in enumerate(views.places, start=1):
        put_mark(picture, view, place.typical.xyyaw[:2], str(number), ALARM if place.blurred or place.bare else INK)
    numbers = (ring_swatch(ALARM), "number: too little to learn from")
    return sheet([[picture]], [("sharpness of what the robot sees", INK)], [*sharpness_legend(), numbers])


def _nearest(
    columns: npt.NDArray[np.intp], rows: npt.NDArray[np.intp], places_px: Float64Array
) -> npt.NDArray[np.intp]:
    """Number of the nearest place for each pixel, shape (N,)."""
    owner, least = np.zeros(len(rows), np.intp), np.full(len(rows), np.inf)
    for number, (x, y) in enumerate(places_px.tolist()):
        squared = (columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2
        closer = squared < least
        owner[closer], least[closer] = number, squared[closer]
    return owner


def add_caption(rgb: UInt8Array, text: str, colour: Rgb = INK) -> UInt8Array:
    """A picture at the size of a thumbnail, with a line of text below it."""
    height, width = rgb.shape[:2]
    size = (TILE_WIDTH_PX, round(height * TILE_WIDTH_PX / width))
    method = cv2.INTER_AREA if width > TILE_WIDTH_PX else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(rgb, size, interpolation=method), dtype=np.uint8)
    caption = np.full((CAPTION_PX, TILE_WIDTH_PX, 3), WHITE, np.uint8)
    size_of_text = next((s for s in (0.4, 0.38, 0.36, 0.34) if text_width_px(text, size=s) < TILE_WIDTH_PX - 6), 0.32)
    put_text(caption, text, (2, 14), size=size_of_text, colour=colour)
    return np.concatenate([image, caption])


def _tile(number: int, place: ViewPlace) -> UInt8Array:
    look = place.typical
    x_m, y_m, _ = look.xyyaw
    text = f"{number}  ({x_m:.1f}, {y_m:.1f})  sharp {look.sharpness:.0f}  surface {100 * look.coverage:.0f} %"
    return add_caption(look.rgb, text, ALARM if place.blurred or place.bare else INK)
