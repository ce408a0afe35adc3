"""Drawing on a scene seen from above: paths, robots, people and goals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from common.maps import GridFrame, OccupancyMap
from common.scenes.top_view import TopView

Rgb = tuple[int, int, int]
Picture = npt.NDArray[np.uint8]

# Wong's palette (Nature Methods 8, 2011): told apart with every common colour vision.
ROBOT: Rgb = (0, 114, 178)
HUMANS: tuple[Rgb, ...] = ((213, 94, 0), (204, 121, 167), (230, 159, 0), (86, 180, 233))
GOAL: Rgb = (0, 158, 115)
INK: Rgb = (38, 44, 52)
_SUBPIXEL_BITS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnEpisode:
    """Where everybody went in one episode."""

    label: str
    """What the report calls it, for example its id and outcome."""
    robot_xy_m: npt.NDArray[np.float64]
    """The robot's way, shape (T, 2)."""
    goal_xy_m: npt.NDArray[np.float64]
    """Shape (2,)."""
    humans_xy_m: tuple[npt.NDArray[np.float64], ...] = ()
    """The ways of the humans while the robot drove, shape (T, 2) each."""


def map_view(occupancy: OccupancyMap, *, pixels_per_cell: int = 4) -> TopView:
    """An occupancy map as a picture: free is near white, occupied is grey."""
    shade = np.where(occupancy.occupied[::-1, :, None], np.uint8(150), np.uint8(250))
    rgb = np.repeat(np.repeat(np.broadcast_to(shade, (*shade.shape[:2], 3)), pixels_per_cell, 0), pixels_per_cell, 1)
    frame = occupancy.frame
    scaled = GridFrame(
        origin_x_m=frame.origin_x_m,
        origin_y_m=frame.origin_y_m,
        resolution_m=frame.resolution_m / pixels_per_cell,
    )
    return TopView(rgb=np.ascontiguousarray(rgb), frame=scaled)


def resized(view: TopView, height_px: int) -> TopView:
    """The same view with another number of rows."""
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


def faded(view: TopView, share: float = 0.35) -> TopView:
    """The same view mixed with white, so that paths on it stand out."""
    rgb = np.rint(view.rgb * (1 - share) + 255 * share).astype(np.uint8)
    return TopView(rgb=rgb, frame=view.frame)


def draw_episodes(view: TopView, episodes: Sequence[DrawnEpisode]) -> Picture:
    """A picture of several episodes: starts as dots, goals as rings, people in warm colours."""
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


def draw_path(picture: Picture, view: TopView, xy_m: npt.NDArray[np.float64], colour: Rgb, *, width_px: int) -> None:
    """A polyline of world points."""
    if len(xy_m) >= 2:
        points = _fixed_point(view.world_to_pixel(xy_m))
        cv2.polylines(picture, [points.reshape(-1, 1, 2)], False, colour, width_px, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_disc(picture: Picture, view: TopView, xy_m: npt.ArrayLike, radius_m: float, colour: Rgb) -> None:
    """A filled disc with a thin white rim."""
    centre, radius = _circle(view, xy_m, radius_m)
    cv2.circle(picture, centre, radius, colour, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, radius, (255, 255, 255), 1, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_goal(picture: Picture, view: TopView, xy_m: npt.ArrayLike, *, radius_m: float) -> None:
    """A ring around a dot."""
    centre, radius = _circle(view, xy_m, radius_m)
    cv2.circle(picture, centre, radius, (255, 255, 255), 4, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, radius, GOAL, 2, cv2.LINE_AA, _SUBPIXEL_BITS)
    cv2.circle(picture, centre, 3 << _SUBPIXEL_BITS, GOAL, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_robot(picture: Picture, view: TopView, xyyaw: npt.NDArray[np.float64], radius_m: float) -> None:
    """The robot's disc with a mark where it looks."""
    draw_disc(picture, view, xyyaw[:2], radius_m, ROBOT)
    heading = np.array([math.cos(xyyaw[2]), math.sin(xyyaw[2])])
    ends = np.stack([xyyaw[:2], xyyaw[:2] + 1.6 * radius_m * heading])
    draw_path(picture, view, ends, (255, 255, 255), width_px=4)
    draw_path(picture, view, ends, ROBOT, width_px=2)


def draw_arrow_head(picture: Picture, view: TopView, xy_m: npt.NDArray[np.float64], colour: Rgb) -> None:
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


def put_text(picture: Picture, text: str, xy_px: tuple[int, int], *, size: float = 0.45, colour: Rgb = INK) -> None:
    """One line of text; `xy_px` is its lower left corner."""
    cv2.putText(picture, text, xy_px, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _circle(view: TopView, xy_m: npt.ArrayLike, radius_m: float) -> tuple[tuple[int, int], int]:
    u, v = _fixed_point(view.world_to_pixel(np.asarray(xy_m, dtype=np.float64)))
    radius = max(2.0, radius_m / view.frame.resolution_m)
    return (int(u), int(v)), round(radius * (1 << _SUBPIXEL_BITS))


def _fixed_point(pixels: npt.NDArray[np.float64]) -> npt.NDArray[np.int32]:
    # OpenCV puts integer coordinates on pixel centres, ours lie at +0.5.
    return np.rint(np.clip(pixels - 0.5, -9000, 9000) * (1 << _SUBPIXEL_BITS)).astype(np.int32)
