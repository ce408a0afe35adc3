"""Drawing on a scene seen from above: paths, robots, humans and goals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, BoolArray, Float64Array, Int32Array, UInt8Array
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.scenes.top_view import TopView

Rgb = tuple[int, int, int]

# Wong's palette (Nature Methods 8, 2011): told apart with every common colour vision.
ROBOT: Rgb = (0, 114, 178)
HUMANS: tuple[Rgb, ...] = ((213, 94, 0), (204, 121, 167), (230, 159, 0), (86, 180, 233))
GOAL: Rgb = (0, 158, 115)
INK: Rgb = (38, 44, 52)
WHITE: Rgb = (255, 255, 255)
FREE, OCCUPIED = 250, 150
"""Grey of free and of occupied map cells, 0..255."""
SCALE_BARS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
SCALE_BAR_SHARE = 0.2
"""Largest share of a picture's width that a scale bar takes."""
_SUBPIXEL_BITS = 4
_MARGIN_M = 0.5
"""Margin of `window_around` [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnEpisode:
    """Paths of robot and humans in one episode."""

    label: str
    """What the report calls it, for example its id and outcome."""
    robot_xy_m: Float64Array
    """Path of the robot [m], shape (T, 2)."""
    goal_xy_m: Float64Array
    """Goal of the robot [m], shape (2,)."""
    humans_xy_m: tuple[Float64Array, ...] = ()
    """Paths of the humans while the robot drove [m], shape (T, 2) each."""


def map_view(occupancy: OccupancyMap, *, pixels_per_cell: int = 4) -> TopView:
    """An occupancy map as a picture: free is near white, occupied is grey."""
    frame, (rows, columns) = occupancy.frame, occupancy.occupied.shape
    size_m = np.array([columns, rows]) * frame.resolution_m
    low_m = np.array([frame.origin_x_m, frame.origin_y_m])
    return map_window(occupancy, low_m, low_m + size_m, pixel_m=frame.resolution_m / pixels_per_cell)


def map_window(occupancy: OccupancyMap, low_m: Float64Array, high_m: Float64Array, *, pixel_m: float) -> TopView:
    """A window of an occupancy map as a picture; what lies beyond the map is drawn as occupied.

    Args:
        occupancy: The map.
        low_m: Lower left corner [m], shape (2,).
        high_m: Upper right corner [m], shape (2,).
        pixel_m: Edge of a pixel [m].
    """
    columns, rows = (max(1, round(size)) for size in ((high_m - low_m) / pixel_m).tolist())
    frame = GridFrame(origin_x_m=float(low_m[0]), origin_y_m=float(low_m[1]), resolution_m=pixel_m)
    window = TopView(rgb=np.full((rows, columns, 3), FREE, np.uint8), frame=frame)
    window.rgb[sample_grid(window, ~occupancy.occupied, occupancy.frame) == 0] = OCCUPIED
    return window


def window_around(occupancy: OccupancyMap, shown: BoolArray, *, side_px: int) -> TopView:
    """The window of an occupancy map that holds some cells, as a picture.

    Args:
        occupancy: The map.
        shown: True for the cells to show, shape (H, W); the whole map if there are none.
        side_px: Longer side of the picture [px].
    """
    cells, frame = np.argwhere(shown if shown.any() else np.ones_like(shown)), occupancy.frame
    corner_m = np.array([frame.origin_x_m, frame.origin_y_m])
    low_m = corner_m + cells.min(axis=0)[::-1] * frame.resolution_m - _MARGIN_M
    high_m = corner_m + (cells.max(axis=0)[::-1] + 1) * frame.resolution_m + _MARGIN_M
    return map_window(occupancy, low_m, high_m, pixel_m=float((high_m - low_m).max()) / side_px)


def sample_grid(view: TopView, values: AnyArray, frame: GridFrame) -> AnyArray:
    """Values of a grid's cells at the pixels of a picture, 0 beyond the grid.

    Args:
        view: Picture of H x W pixels.
        values: Values of the cells, shape (R, C); row 0 has the smallest y.
        frame: Frame of the grid.

    Returns:
        Shape (H, W).
    """
    (height, width), pixels = view.rgb.shape[:2], view.frame
    x_m = pixels.origin_x_m + (np.arange(width) + 0.5) * pixels.resolution_m
    y_m = pixels.origin_y_m + (np.arange(height)[::-1] + 0.5) * pixels.resolution_m
    j = np.floor((x_m - frame.origin_x_m) / frame.resolution_m).astype(np.int64) + 1
    i = np.floor((y_m - frame.origin_y_m) / frame.resolution_m).astype(np.int64) + 1
    padded = np.pad(values, 1)
    sampled: AnyArray = padded[np.clip(i, 0, padded.shape[0] - 1)[:, None], np.clip(j, 0, padded.shape[1] - 1)[None, :]]
    return sampled


def resize_view(view: TopView, height_px: int) -> TopView:
    """The view with another number of rows."""
    rows, columns = view.rgb.shape[:2]
    scale = height_px / rows
    shape = (max(1, round(columns * scale)), height_px)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    frame = GridFrame(
        origin_x_m=view.frame.origin_x_m,
        origin_y_m=view.frame.origin_y_m,
        resolution_m=view.frame.resolution_m / scale,
    )
    return TopView(rgb=np.asarray(cv2.resize(view.rgb, shape, interpolation=method), dtype=np.uint8), frame=frame)


def fade_view(view: TopView, share: float = 0.35) -> TopView:
    """The view mixed with white, so that paths on it stand out."""
    rgb = np.rint(view.rgb * (1 - share) + 255 * share).astype(np.uint8)
    return TopView(rgb=rgb, frame=view.frame)


def draw_episodes(view: TopView, episodes: Sequence[DrawnEpisode]) -> UInt8Array:
    """A picture of several episodes: starts as dots, goals as rings, humans in warm colours."""
    picture = view.rgb.copy()
    for episode in episodes:
        for k, way in enumerate(episode.humans_xy_m):
            draw_path(picture, view, way, HUMANS[k % len(HUMANS)], width_px=2)
            if len(way):
                draw_arrow_head(picture, view, way, HUMANS[k % len(HUMANS)])
    for episode in episodes:
        draw_path(picture, view, episode.robot_xy_m, ROBOT, width_px=3)
        draw_goal(picture, view, episode.goal_xy_m, radius_m=0.16)
        if len(episode.robot_xy_m):
            draw_disc(picture, view, episode.robot_xy_m[0], 0.11, ROBOT)
    return picture


def draw_path(picture: UInt8Array, view: TopView, xy_m: Float64Array, colour: Rgb, *, width_px: int = 2) -> None:
    """A polyline of world points."""
    if len(xy_m) >= 2:
        points = _fixed_point(view.world_to_pixel(xy_m))
        cv2.polylines(picture, [points.reshape(-1, 1, 2)], False, colour, width_px, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_disc(picture: UInt8Array, view: TopView, xy_m: npt.ArrayLike, radius_m: float, colour: Rgb) -> None:
    """A filled disc with a thin white rim."""
    centre, radius = _circle(view, xy_m, radius_m)
    cv2.circle(picture, centre, radius, colour, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, radius, (255, 255, 255), 1, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_goal(picture: UInt8Array, view: TopView, xy_m: npt.ArrayLike, *, radius_m: float) -> None:
    """A ring around a dot."""
    centre, radius = _circle(view, xy_m, radius_m)
    cv2.circle(picture, centre, radius, (255, 255, 255), 4, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, radius, GOAL, 2, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, 3 << _SUBPIXEL_BITS, GOAL, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_robot(picture: UInt8Array, view: TopView, xyyaw: Float64Array, radius_m: float) -> None:
    """The robot's disc with a mark where it looks."""
    draw_disc(picture, view, xyyaw[:2], radius_m, ROBOT)
    heading = np.array([math.cos(xyyaw[2]), math.sin(xyyaw[2])])
    ends = np.stack([xyyaw[:2], xyyaw[:2] + 1.6 * radius_m * heading])
    draw_path(picture, view, ends, (255, 255, 255), width_px=4)
    draw_path(picture, view, ends, ROBOT, width_px=2)


def draw_arrow_head(picture: UInt8Array, view: TopView, xy_m: Float64Array, colour: Rgb) -> None:
    """An arrow head at the end of a path; a dot where the path does not move."""
    moved = np.nonzero(np.hypot(*(xy_m - xy_m[-1]).T) > 0.1)[0]
    if not len(moved):
        draw_disc(picture, view, xy_m[-1], 0.08, colour)
        return
    along = xy_m[-1] - xy_m[moved[-1]]
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])
    corners = np.stack([xy_m[-1] + 0.12 * along, xy_m[-1] + 0.11 * across, xy_m[-1] - 0.11 * across])
    cv2.fillPoly(picture, [_fixed_point(view.world_to_pixel(corners))], colour, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_ring(picture: UInt8Array, view: TopView, xy_m: npt.ArrayLike, radius_m: float, colour: Rgb) -> None:
    """A thin circle."""
    centre, radius = _circle(view, xy_m, radius_m)
    cv2.circle(picture, centre, radius, colour, 1, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_scale_bar(picture: UInt8Array, view: TopView) -> None:
    """A bar of a round length, at most a fifth of the picture's width, in the lower left corner."""
    room_m = SCALE_BAR_SHARE * picture.shape[1] * view.frame.resolution_m
    length_m = max((length for length in SCALE_BARS_M if length <= room_m), default=SCALE_BARS_M[0])
    length_px, bottom = round(length_m / view.frame.resolution_m), picture.shape[0] - 12
    # Large pictures are looked at from further away.
    k = max(1, round(picture.shape[1] / 1000))
    for grown, colour in ((k + 1, WHITE), (0, INK)):
        corners = (12 - grown, bottom - 2 * k - grown), (12 + length_px + grown, bottom + 2 * k + grown)
        cv2.rectangle(picture, *corners, colour, cv2.FILLED)
    put_text(picture, f"{length_m:g} m", (12, bottom - 10 * k), size=0.5 * k, halo=WHITE)


def fill_area(picture: UInt8Array, view: TopView, corners_m: Float64Array, colour: Rgb, *, share: float) -> None:
    """A polygon that what is below shines through.

    Args:
        picture: Drawn on.
        view: Where the picture lies.
        corners_m: Corners [m], shape (N, 2).
        colour: Colour of the area.
        share: How much of the colour the area takes, 0..1.
    """
    mask = np.zeros(picture.shape[:2], np.uint8)
    cv2.fillPoly(mask, [_fixed_point(view.world_to_pixel(corners_m))], 255, cv2.LINE_8, _SUBPIXEL_BITS)
    _blend(picture, mask, colour, share)


def fill_band(
    picture: UInt8Array, view: TopView, xy_m: Float64Array, radius_m: float, colour: Rgb, *, share: float
) -> None:
    """All within a radius of a path, with a thin outline; what is below shines through.

    Args:
        picture: Drawn on.
        view: Where the picture lies.
        xy_m: The path [m], shape (N, 2) with N >= 1.
        radius_m: Half of the band's width [m].
        colour: Colour of the band.
        share: How much of the colour the band takes, 0..1.
    """
    mask = np.zeros(picture.shape[:2], np.uint8)
    points = _fixed_point(view.world_to_pixel(xy_m)).reshape(-1, 1, 2)
    width = max(1, round(2 * radius_m / view.frame.resolution_m))
    cv2.polylines(mask, [points], False, 255, width, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(
        mask, points[0, 0].tolist(), (width << _SUBPIXEL_BITS) // 2, 255, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS
    )
    _blend(picture, mask, colour, share)
    outlines, _ = cv2.findContours((mask > 127).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, outlines, -1, colour, 1, cv2.LINE_AA)


def _blend(picture: UInt8Array, mask: UInt8Array, colour: Rgb, share: float) -> None:
    """Mix a colour into the pixels of a mask."""
    x, y, width, height = cv2.boundingRect(mask)
    box = (slice(y, y + height), slice(x, x + width))
    if width == 0:
        return
    table = np.arange(256)[:, None] * (1 - share) + np.array(colour) * share
    ground = np.ascontiguousarray(picture[box])
    mixed = cv2.LUT(ground, np.rint(table).astype(np.uint8)[None])
    picture[box] = cv2.copyTo(mixed, (mask[box] > 127).astype(np.uint8), ground)


def put_text(
    picture: UInt8Array,
    text: str,
    xy_px: tuple[int, int],
    *,
    size: float = 0.45,
    colour: Rgb = INK,
    halo: Rgb | None = None,
) -> None:
    """One line of text.

    Args:
        picture: Drawn on.
        text: ASCII.
        xy_px: Its lower left corner.
        size: 1 is letters of about 22 px.
        colour: Colour of the letters.
        halo: Colour around them, without which they vanish on a background of the same colour.
    """
    width = max(1, round(size))
    if halo is not None:
        mask = np.zeros(picture.shape[:2], np.uint8)
        cv2.putText(mask, text, xy_px, cv2.FONT_HERSHEY_SIMPLEX, size, (255,), width, cv2.LINE_AA)
        picture[cv2.dilate(mask, np.ones((4 * width + 1, 4 * width + 1), np.uint8)) > 0] = halo
    cv2.putText(picture, text, xy_px, cv2.FONT_HERSHEY_SIMPLEX, size, colour, width, cv2.LINE_AA)


def text_width_px(text: str, *, size: float = 0.45) -> int:
    """Width of a line of text [px]."""
    return int(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0])


def put_mark(picture: UInt8Array, view: TopView, xy_m: npt.ArrayLike, text: str, colour: Rgb) -> None:
    """Draw a short text, such as a number, in a disc."""
    u, v = (round(float(value)) for value in view.world_to_pixel(xy_m) - 0.5)
    cv2.circle(picture, (u, v), 10, WHITE, cv2.FILLED, cv2.LINE_AA)
    cv2.circle(picture, (u, v), 9, colour, cv2.FILLED, cv2.LINE_AA)
    put_text(picture, text, (u - text_width_px(text) // 2, v + 5), colour=WHITE)


def _circle(view: TopView, xy_m: npt.ArrayLike, radius_m: float) -> tuple[tuple[int, int], int]:
    u, v = _fixed_point(view.world_to_pixel(np.asarray(xy_m, dtype=np.float64)))
    radius = max(2.0, radius_m / view.frame.resolution_m)
    return (int(u), int(v)), round(radius * (1 << _SUBPIXEL_BITS))


def _fixed_point(pixels: Float64Array) -> Int32Array:
    # OpenCV puts integer coordinates on pixel centres, ours lie at +0.5.
    return np.rint(np.clip(pixels - 0.5, -9000, 9000) * (1 << _SUBPIXEL_BITS)).astype(np.int32)
