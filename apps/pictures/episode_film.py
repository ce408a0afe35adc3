"""A video of one episode: the scene from above, beside the robot's camera images."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, repeat

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, UInt8Array
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import GOAL, HUMANS, INK, ROBOT, Rgb
from readygo.common.drawing.sheet import Swatch, legend_strip
from readygo.common.robot.kinematics import RATE_HZ
from readygo.common.scenes.top_view import TopView

CAMERA_HEIGHT_PX = 432
"""Approximate height of the robot's view [px]: it is enlarged by an integer factor."""
PLAN_HEIGHT_PX, PLAN_WIDTH_MAX_PX = 640, 1000
_WIDTH_MIN_PX = 860
_MARGIN_PX = 8
_BAR_HEIGHT_PX = 56
_TIMELINE_HEIGHT_PX = 16
_PAPER: Rgb = (250, 250, 248)
_TRACK: Rgb = (222, 224, 226)

Underlay = Callable[[UInt8Array, TopView, int], None]
"""Draws additional content of a row of the video on a picture, in a top view."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeFilm:
    """One episode, row by row at the simulation's rate."""

    title: str
    xyyaw: Float64Array
    """Pose of the robot: x [m], y [m], yaw [rad], shape (T, 3)."""
    actions: Float64Array
    """Command from each row on: v [m/s], w [rad/s], shape (T, 2)."""
    goal_xy_m: Float64Array
    """Goal in the world [m], shape (2,)."""
    camera: Iterable[UInt8Array] | None = None
    """Images of the robot's camera, T of shape (H, W, 3); read once, in order, so that an iterator may render them."""
    enlarged: bool = True
    """True enlarges the camera's images; False shows them at their size."""
    humans_xy_m: tuple[Float64Array, ...] = ()
    """Ground positions of each human, shape (T_h, 2); the last row is held."""
    outcome: str = ""
    """Shown on the last second, for example "success"."""
    underlay: Underlay | None = None
    """Draws content below robot and humans."""
    overlay: Underlay | None = None
    """Draws content above robot and humans."""
    legend: Sequence[tuple[Swatch, str]] = ()
    """The meaning of further marks, shown below everything else."""
    human_visible: BoolArray | None = None
    """For the time line: True at rows where the robot sees a human, shape (T,)."""
    replanned: BoolArray | None = None
    """For the time line: True at rows where the expert replanned, shape (T,)."""
    robot_radius_m: float = 0.25
    human_radius_m: float = 0.25
    success_radius_m: float = 1.0
    rate_hz: int = RATE_HZ
    """Rows per second [Hz]."""
    v_max_mps: float = 1.0
    w_max_radps: float = 1.2

    def __post_init__(self) -> None:
        count = len(self.xyyaw)
        if count == 0:
            raise ValueError("a film needs at least one row.")
        if self.xyyaw.shape != (count, 3) or self.actions.shape != (count, 2):
            raise ValueError(
                f"xyyaw and actions must be (T, 3) and (T, 2) with one T, "
                f"got {self.xyyaw.shape} and {self.actions.shape}."
            )


def film_frames(
    film: EpisodeFilm, view: TopView, *, camera_height_px: int = CAMERA_HEIGHT_PX, step: int = 1
) -> Iterator[UInt8Array]:
    """The video's frames, every `step`-th row, with even width and height, sRGB.

    Args:
        film: The episode.
        view: The scene from above.
        camera_height_px: Approximate height of the robot's view [px], which is enlarged by an integer factor; if it is
            not enlarged, the smallest height of the top view.
        step: Rows from frame to frame.

    Raises:
        ValueError: If the camera has fewer images than the video has rows.
    """
    rows = range(0, len(film.xyyaw), step)
    images = repeat(None) if film.camera is None else islice(film.camera, 0, None, step)
    background: TopView | None = None
    shown = 0
    for row, image in zip(rows, images, strict=False):
        camera = image if image is None or not film.enlarged else enlarge(image, camera_height_px)
        if background is None:
            background = plan_view.fade_view(
                _fit_plan_view(view, _plan_height_px(film, camera, camera_height_px)), 0.25
            )
        shown += 1
        yield _frame(film, background, row, camera)
    if shown < len(rows):
        raise ValueError(f"the camera has {shown} images for {len(rows)} rows.")


def _plan_height_px(film: EpisodeFilm, camera: UInt8Array | None, camera_height_px: int) -> int:
    if camera is None:
        return PLAN_HEIGHT_PX
    return len(camera) if film.enlarged else max(len(camera), camera_height_px)


def enlarge(image: UInt8Array, height_px: int) -> UInt8Array:
    """An image, enlarged by an integer factor to about `height_px`."""
    scale = max(1, round(height_px / image.shape[0]))
    size = (image.shape[1] * scale, image.shape[0] * scale)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _fit_plan_view(view: TopView, height_px: int) -> TopView:
    rows, columns = view.rgb.shape[:2]
    return plan_view.resize_view(view, min(height_px, max(1, PLAN_WIDTH_MAX_PX * rows // columns)))


def _frame(film: EpisodeFilm, background: TopView, row: int, camera: UInt8Array | None) -> UInt8Array:
    parts = [part for part in (camera, _plan(film, background, row)) if part is not None]
    top = max(len(part) for part in parts) + 2 * _MARGIN_PX
    height = top + _BAR_HEIGHT_PX + _TIMELINE_HEIGHT_PX + _MARGIN_PX
    width = max(_WIDTH_MIN_PX, sum(part.shape[1] + _MARGIN_PX for part in parts) + _MARGIN_PX)
    picture = np.full((height + height % 2, width + width % 2, 3), _PAPER, dtype=np.uint8)
    left = _MARGIN_PX
    for part in parts:
        picture[_MARGIN_PX : _MARGIN_PX + len(part), left : left + part.shape[1]] = part
        left += part.shape[1] + _MARGIN_PX
    _dashboard(picture, film, row, top=top)
    _timeline(picture, film, row, top=top + _BAR_HEIGHT_PX)
    return np.concatenate([picture, legend_strip(picture.shape[1], film.legend)]) if film.legend else picture


def _plan(film: EpisodeFilm, view: TopView, step: int) -> UInt8Array:
    picture = view.rgb.copy()
    if film.underlay is not None:
        film.underlay(picture, view, step)
    plan_view.draw_path(picture, view, film.xyyaw[: step + 1, :2], ROBOT)
    plan_view.draw_ring(picture, view, film.goal_xy_m, film.success_radius_m, GOAL)
    plan_view.draw_goal(picture, view, film.goal_xy_m, radius_m=0.18)
    for k, way in enumerate(film.humans_xy_m):
        colour = HUMANS[k % len(HUMANS)]
        now = min(step, len(way) - 1)
        plan_view.draw_path(picture, view, way[: now + 1], colour)
        plan_view.draw_disc(picture, view, way[now], film.human_radius_m, colour)
    plan_view.draw_robot(picture, view, film.xyyaw[step], film.robot_radius_m)
    if film.overlay is not None:
        film.overlay(picture, view, step)
    return picture


def _dashboard(picture: UInt8Array, film: EpisodeFilm, row: int, *, top: int) -> None:
    """Title, time, and bars for v and w below the pictures."""
    v, w = (float(value) for value in film.actions[row])
    distance = float(np.hypot(*(film.goal_xy_m - film.xyyaw[row, :2])))
    left, middle = _MARGIN_PX + 4, picture.shape[1] * 3 // 10
    plan_view.put_text(picture, film.title, (left, top + 18), size=0.5)
    plan_view.put_text(picture, f"t {row / film.rate_hz:5.1f} s    goal {distance:4.1f} m", (left, top + 42), size=0.5)
    length = picture.shape[1] // 5
    _bar(picture, (middle, top + 6), f"v {v:5.2f} m/s", v / film.v_max_mps, length=length, signed=False)
    _bar(picture, (middle, top + 30), f"w {w:5.2f} rad/s", -w / film.w_max_radps, length=length, signed=True)
    if film.outcome and (len(film.xyyaw) - row) / film.rate_hz <= 1.0:
        colour = GOAL if film.outcome == "success" else HUMANS[0]
        plan_view.put_text(picture, film.outcome, (middle + length + 170, top + 32), size=0.7, colour=colour)


def _bar(picture: UInt8Array, corner: tuple[int, int], label: str, share: float, *, length: int, signed: bool) -> None:
    """A labelled bar; a signed one grows from its middle, to the left for left turns."""
    x, y = corner
    plan_view.put_text(picture, label, (x, y + 13))
    begin, height = x + 120, 15
    cv2.rectangle(picture, (begin, y), (begin + length, y + height), _TRACK, cv2.FILLED)
    zero = begin + length // 2 if signed else begin
    reach = round(float(np.clip(share, -1.0, 1.0)) * (length // 2 if signed else length))
    low, high = sorted((zero, max(zero + reach, begin)))
    cv2.rectangle(picture, (low, y), (high, y + height), ROBOT, cv2.FILLED)
    cv2.line(picture, (zero, y - 2), (zero, y + height + 2), INK, 1)


def _timeline(picture: UInt8Array, film: EpisodeFilm, row: int, *, top: int) -> None:
    """The whole episode as a bar: warm where a human is in view, ticks at replans, a line at the row shown."""
    count, left, right = len(film.xyyaw), _MARGIN_PX + 4, picture.shape[1] - _MARGIN_PX - 4
    places = np.linspace(left, right, count + 1).astype(int).tolist()
    cv2.rectangle(picture, (left, top + 3), (right, top + 11), _TRACK, cv2.FILLED)
    for k in _steps(film.human_visible):
        cv2.rectangle(picture, (places[k], top + 3), (places[k + 1], top + 11), HUMANS[2], cv2.FILLED)
    for k in _steps(film.replanned):
        cv2.line(picture, (places[k], top + 8), (places[k], top + 11), INK, 1)
    cv2.rectangle(picture, (places[row] - 1, top), (places[row] + 1, top + 14), ROBOT, cv2.FILLED)


def _steps(flags: BoolArray | None) -> Sequence[int]:
    steps: list[int] = [] if flags is None else np.flatnonzero(flags).tolist()
    return steps
