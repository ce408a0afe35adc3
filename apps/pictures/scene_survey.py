"""Views of a Gaussian file along its three axes, with planes that may be its floor."""

import math
from dataclasses import replace

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing.plan_view import HUMANS, INK, ROBOT, WHITE, Rgb, put_text, text_width_px
from readygo.common.drawing.sheet import line_swatch, sheet
from readygo.common.gaussians import GaussianCloud, transform_cloud
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.scenes.survey import Survey, UpCandidate, survey
from readygo.common.scenes.top_view import TopView, draw_top_view

VIEW_PX = 560
MARGIN = 0.12
"""Margin around the extent, as a share of it."""
CEILING = 0.6
"""Share of the height that is drawn from above, so that a ceiling hides nothing."""
COLOURS: tuple[Rgb, ...] = (ROBOT, HUMANS[0], HUMANS[1])
AXES = "xyz"
VIEWS = ((0, 1, (0, 0, 1)), (0, 2, (0, -1, 0)), (1, 2, (1, 0, 0)))
"""For each view: axis to the right, axis upwards, and direction to the viewer."""


def change_picture(before: GaussianCloud, after: GaussianCloud, words: str) -> UInt8Array:
    """The change by an edit: the views before it above those after it, each with a separate grid.

    Args:
        before: Gaussians before the edit, in metres, z up.
        after: Gaussians after the edit.
        words: Description of the edit.

    Returns:
        RGB image, shape (H, W, 3).
    """
    rows = []
    for cloud in (before, after):
        plain = replace(cloud, sh=np.ascontiguousarray(cloud.sh[:, :1]))
        found = survey(cloud)
        rows.append([_view(plain, found, (), *view) for view in VIEWS])
    counts = f"above: before, {len(before):,} Gaussians; below: after, {len(after):,}"
    return sheet(rows, [(words, INK), (counts, INK)], [])


def survey_picture(cloud: GaussianCloud, found: Survey, headline: str) -> UInt8Array:
    """Three views with a grid in units of the file.

    Args:
        cloud: Gaussians of the survey.
        found: Result of the survey.
        headline: Name of the file.

    Returns:
        RGB image, shape (H, W, 3).
    """
    plain = replace(cloud, sh=np.ascontiguousarray(cloud.sh[:, :1]))
    candidates = found.likely_ups
    views = [_view(plain, found, candidates, *view) for view in VIEWS]
    legend = [
        (line_swatch(colour, 3), f"--up={up.name}: floor at {up.floor:.3g}, {100 * up.support:.1f} % of the surface")
        for colour, up in zip(COLOURS, candidates, strict=False)
    ]
    size = " x ".join(f"{value:.4g}" for value in found.high - found.low)
    words = [(headline, INK), (f"{found.gaussians:,} Gaussians, {size} units of the file (98 %)", INK)]
    return sheet([views], words, legend)


def _view(
    cloud: GaussianCloud,
    found: Survey,
    candidates: tuple[UpCandidate, ...],
    right: int,
    upwards: int,
    viewer: tuple[int, int, int],
) -> UInt8Array:
    R = np.stack([np.eye(3)[right], np.eye(3)[upwards], np.array(viewer, dtype=np.float64)])
    low, high = _box(found, right), _box(found, upwards)
    pixel = max(low[1] - low[0], high[1] - high[0]) / VIEW_PX
    frame = GridFrame(origin_x_m=low[0], origin_y_m=high[0], resolution_m=pixel)
    shape = tuple(max(80, round((ends[1] - ends[0]) / pixel)) for ends in (high, low))
    moved = transform_cloud(cloud, R)
    near, far = sorted((float(R[2] @ found.low), float(R[2] @ found.high)))
    up = candidates[0].up if candidates else np.array([0.0, 0.0, 1.0])
    looks_down = float(R[2] @ up) > 0.9
    top = near + CEILING * (far - near) if looks_down else math.inf
    ground = FloorMap(frame=frame, height_m=np.zeros((1, 1), np.float32))
    view = draw_top_view(moved, ground, frame, (shape[0], shape[1]), ceiling_m=top)
    picture = np.ascontiguousarray(view.rgb)
    _draw_grid(picture, view, (right, upwards))
    for colour, candidate in list(zip(COLOURS, candidates, strict=False))[::-1]:
        _draw_floor(picture, view, R @ candidate.up, candidate.floor, colour)
    return _add_title(picture, right, upwards, R[2])


def _box(found: Survey, axis: int) -> tuple[float, float]:
    size = float(max((found.high - found.low).max() * 0.05, found.high[axis] - found.low[axis]))
    middle = 0.5 * float(found.low[axis] + found.high[axis])
    return middle - (0.5 + MARGIN) * size, middle + (0.5 + MARGIN) * size


def _draw_grid(picture: UInt8Array, view: TopView, axes: tuple[int, int]) -> None:
    """Lines at round numbers, named at the rim."""
    rows, columns = picture.shape[:2]
    frame = view.frame
    step = _round_step(max(rows, columns) * frame.resolution_m / 6)
    for axis, origin, length in ((0, frame.origin_x_m, columns), (1, frame.origin_y_m, rows)):
        first = math.ceil(origin / step)
        for k in range(first, math.floor((origin + length * frame.resolution_m) / step) + 1):
            at = (k * step - origin) / frame.resolution_m
            ends = ((at, 0), (at, rows)) if axis == 0 else ((0, rows - at), (columns, rows - at))
            start, end = ((round(u), round(v)) for u, v in ends)
            cv2.line(picture, start, end, (140, 146, 152), 1)
            label = f"{AXES[axes[axis]]} {k * step:g}" if k == first else f"{k * step:g}"
            _put_label(picture, label, (round(at) + 3, rows - 6) if axis == 0 else (4, round(rows - at) - 3))


def _round_step(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    return next(power * digit for digit in (1, 2, 5, 10) if power * digit >= value)


def _draw_floor(picture: UInt8Array, view: TopView, up: Float64Array, floor: float, colour: Rgb) -> None:
    """A plane that is seen from its side, as a line with an arrow that points up."""
    across = float(np.hypot(up[0], up[1]))
    if across < 0.95:
        return
    normal = up[:2] / across
    rows, columns = picture.shape[:2]
    frame = view.frame
    middle = np.array([frame.origin_x_m, frame.origin_y_m]) + 0.5 * frame.resolution_m * np.array([columns, rows])
    foot = middle + (floor / across - float(normal @ middle)) * normal
    reach = frame.resolution_m * (rows + columns)
    along = np.array([-normal[1], normal[0]])
    line = view.world_to_pixel(np.stack([foot - reach * along, foot + reach * along]))
    ends = view.world_to_pixel(np.stack([foot, foot + 60 * frame.resolution_m * normal]))
    (a, b), (c, d) = (np.rint(points).astype(int).tolist() for points in (line, ends))
    cv2.line(picture, a, b, colour, 3, cv2.LINE_AA)
    cv2.arrowedLine(picture, c, d, colour, 3, cv2.LINE_AA, tipLength=0.3)


def _put_label(picture: UInt8Array, text: str, xy_px: tuple[int, int]) -> None:
    x, y = xy_px
    cv2.rectangle(picture, (x - 2, y - 11), (x + text_width_px(text, size=0.4) + 2, y + 4), WHITE, cv2.FILLED)
    put_text(picture, text, xy_px, size=0.4)


def _add_title(picture: UInt8Array, right: int, upwards: int, viewer: Float64Array) -> UInt8Array:
    axis = int(np.argmax(np.abs(viewer)))
    side = "+" if viewer[axis] > 0 else "-"
    text = f"seen from {side}{AXES[axis]}: {AXES[right]} to the right, {AXES[upwards]} upwards"
    width = max(picture.shape[1], text_width_px(text) + 6)
    titled = np.full((24 + len(picture), width, 3), WHITE, np.uint8)
    titled[24:, : picture.shape[1]] = picture
    put_text(titled, text, (2, 17))
    return titled
