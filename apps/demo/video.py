"""A film of one episode: what the robot sees beside the scene from above."""

import itertools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from apps.demo import plan_view
from apps.demo.plan_view import GOAL, HUMANS, INK, ROBOT, Picture, Rgb
from common.errors import ReadygoError
from common.robot.kinematics import DT_S
from common.scenes.top_view import TopView

VIDEO_CODEC = "mp4v"
"""MPEG-4 part 2, which every build of OpenCV writes, some 80 times faster than VP9; for browsers there is the WebP."""
ANIMATION_QUALITY = 60
_MARGIN_PX = 8
_BAR_HEIGHT_PX = 56
_PAPER: Rgb = (250, 250, 248)


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeFilm:
    """One episode, row by row at the simulation's rate."""

    title: str
    rgb: Sequence[npt.NDArray[np.uint8]]
    """Images of the robot's camera, T of shape (H, W, 3)."""
    xyyaw: npt.NDArray[np.float64]
    """Pose of the robot: x [m], y [m], yaw [rad], shape (T, 3)."""
    actions: npt.NDArray[np.float64]
    """Command from each row on: v [m/s], w [rad/s], shape (T, 2)."""
    goal_xy_m: npt.NDArray[np.float64]
    """Shape (2,)."""
    humans_xy_m: tuple[npt.NDArray[np.float64], ...] = ()
    """Ground positions of each human, shape (T_h, 2); the last row is held."""
    outcome: str = ""
    """Shown on the last second, for example "success"."""
    robot_radius_m: float = 0.25
    human_radius_m: float = 0.25
    success_radius_m: float = 1.0
    v_max_mps: float = 1.0
    w_max_radps: float = 1.2

    def __post_init__(self) -> None:
        count = len(self.rgb)
        if count == 0:
            raise ValueError("a film needs at least one image.")
        if self.xyyaw.shape != (count, 3) or self.actions.shape != (count, 2):
            raise ValueError(
                f"xyyaw and actions must be ({count}, 3) and ({count}, 2) for {count} images, "
                f"got {self.xyyaw.shape} and {self.actions.shape}."
            )


def write_episode_video(
    path: Path, film: EpisodeFilm, top_view: TopView, *, fps: int = 20, camera_scale: int = 3
) -> None:
    """Write an MP4 with the robot's view beside the scene from above.

    Args:
        path: File to write; it appears under this name only when it is complete.
        film: The episode.
        top_view: The scene from above.
        fps: Images per second; 20 is the simulation's rate.
        camera_scale: Enlargement of the robot's view.

    Raises:
        ReadygoError: If this OpenCV cannot write the video.
    """
    frames = film_frames(film, top_view, camera_scale=camera_scale)
    first = next(frames)
    with _unfinished(path, ".mp4") as unfinished:
        size = (first.shape[1], first.shape[0])
        writer = cv2.VideoWriter(str(unfinished), cv2.VideoWriter.fourcc(*VIDEO_CODEC), fps, size)
        if not writer.isOpened():
            raise ReadygoError(
                f"OpenCV {cv2.__version__} cannot write {path}; install opencv-python-headless from PyPI."
            )
        for frame in itertools.chain([first], frames):
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
        writer.release()


def write_episode_animation(
    path: Path, film: EpisodeFilm, top_view: TopView, *, step: int = 2, camera_scale: int = 2
) -> None:
    """Write an animated WebP, which browsers play inside of a page, at the film's own pace.

    Args:
        path: File to write; it appears under this name only when it is complete.
        film: The episode.
        top_view: The scene from above.
        step: Every how many rows an image is shown; 2 are 10 images per second.
        camera_scale: Enlargement of the robot's view.
    """
    animation = cv2.Animation()
    animation.frames = [
        np.ascontiguousarray(frame[..., ::-1])
        for frame in film_frames(film, top_view, camera_scale=camera_scale, step=step)
    ]
    durations_ms = [round(1000 * DT_S * step)] * len(animation.frames)
    # The end stays on for a moment before the film begins anew.
    durations_ms[-1] = 1500
    animation.durations = durations_ms
    with _unfinished(path, ".webp") as unfinished:
        if not cv2.imwriteanimation(str(unfinished), animation, [cv2.IMWRITE_WEBP_QUALITY, ANIMATION_QUALITY]):
            raise ReadygoError(
                f"OpenCV {cv2.__version__} cannot write {path}; install opencv-python-headless from PyPI."
            )


def film_frames(film: EpisodeFilm, top_view: TopView, *, camera_scale: int, step: int = 1) -> Iterator[Picture]:
    """The film's pictures, every `step`-th row, even in width and height, sRGB."""
    background = plan_view.faded(plan_view.resized(top_view, film.rgb[0].shape[0] * camera_scale), 0.25)
    for row in range(0, len(film.rgb), step):
        camera = film.rgb[row]
        size = (camera.shape[1] * camera_scale, camera.shape[0] * camera_scale)
        enlarged = np.asarray(cv2.resize(camera, size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
        plan = _plan(film, background, row)
        height = len(enlarged) + _BAR_HEIGHT_PX + 3 * _MARGIN_PX
        width = enlarged.shape[1] + plan.shape[1] + 3 * _MARGIN_PX
        picture = np.full((height + height % 2, width + width % 2, 3), _PAPER, dtype=np.uint8)
        _paste(picture, enlarged, _MARGIN_PX, _MARGIN_PX)
        _paste(picture, plan, enlarged.shape[1] + 2 * _MARGIN_PX, _MARGIN_PX)
        _dashboard(picture, film, row, top=len(enlarged) + 2 * _MARGIN_PX)
        yield picture


def _plan(film: EpisodeFilm, view: TopView, step: int) -> Picture:
    picture = view.rgb.copy()
    plan_view.draw_path(picture, view, film.xyyaw[: step + 1, :2], ROBOT, width_px=2)
    centre = view.world_to_pixel(film.goal_xy_m) - 0.5
    radius = round(film.success_radius_m / view.frame.resolution_m)
    cv2.circle(picture, (round(centre[0]), round(centre[1])), radius, GOAL, 1, cv2.LINE_AA)
    plan_view.draw_goal(picture, view, film.goal_xy_m, radius_m=0.18)
    for k, way in enumerate(film.humans_xy_m):
        colour = HUMANS[k % len(HUMANS)]
        now = min(step, len(way) - 1)
        plan_view.draw_path(picture, view, way[: now + 1], colour, width_px=2)
        plan_view.draw_disc(picture, view, way[now], film.human_radius_m, colour)
    plan_view.draw_robot(picture, view, film.xyyaw[step], film.robot_radius_m)
    return picture


def _dashboard(picture: Picture, film: EpisodeFilm, row: int, *, top: int) -> None:
    """Title, time, and bars for v and w below the pictures."""
    v, w = (float(value) for value in film.actions[row])
    distance = float(np.hypot(*(film.goal_xy_m - film.xyyaw[row, :2])))
    left, middle = _MARGIN_PX + 4, picture.shape[1] * 3 // 10
    plan_view.put_text(picture, film.title, (left, top + 18), size=0.5)
    plan_view.put_text(picture, f"t {row * DT_S:5.1f} s    goal {distance:4.1f} m", (left, top + 42), size=0.5)
    length = picture.shape[1] // 5
    _bar(picture, (middle, top + 6), f"v {v:5.2f} m/s", v / film.v_max_mps, length=length, signed=False)
    _bar(picture, (middle, top + 30), f"w {w:5.2f} rad/s", -w / film.w_max_radps, length=length, signed=True)
    if film.outcome and (len(film.rgb) - row) * DT_S <= 1.0:
        colour = GOAL if film.outcome == "success" else HUMANS[0]
        plan_view.put_text(picture, film.outcome, (middle + length + 170, top + 32), size=0.7, colour=colour)


def _bar(picture: Picture, corner: tuple[int, int], label: str, share: float, *, length: int, signed: bool) -> None:
    """A labelled bar; a signed one grows from its middle, to the left for left turns."""
    x, y = corner
    plan_view.put_text(picture, label, (x, y + 13))
    begin, height = x + 120, 15
    cv2.rectangle(picture, (begin, y), (begin + length, y + height), (222, 224, 226), cv2.FILLED)
    zero = begin + length // 2 if signed else begin
    reach = round(float(np.clip(share, -1.0, 1.0)) * (length // 2 if signed else length))
    low, high = sorted((zero, max(zero + reach, begin)))
    cv2.rectangle(picture, (low, y), (high, y + height), ROBOT, cv2.FILLED)
    cv2.line(picture, (zero, y - 2), (zero, y + height + 2), INK, 1)


def _paste(picture: Picture, part: Picture, x: int, y: int) -> None:
    picture[y : y + part.shape[0], x : x + part.shape[1]] = part


@contextmanager
def _unfinished(path: Path, suffix: str) -> Iterator[Path]:
    """A temporary name that becomes `path` when the block ends well."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}-") as folder:
            unfinished = Path(folder) / f"film{suffix}"
            yield unfinished
            unfinished.replace(path)
    except OSError as error:
        raise ReadygoError(f"{path} cannot be written: {error.strerror or error}.") from error
