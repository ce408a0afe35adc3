"""Frames of videos."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.select import FrameScores, choose_frames, motion, sharpness, small_grey

FRAMES_MIN = 10
_STEP = 0.05
"""Movement of the picture from one used image to the next, as share of its width."""
_WAY_MIN = 0.3
"""A picture that moved less in all, as share of its width, was not filmed walking."""
JPEG_QUALITY = 97

# FFmpeg writes what it thinks of a broken file to stderr itself, beside our line.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def extract_frames(video: Path, folder: Path, config: FramesConfig) -> dict[str, Any]:
    """Write the frames of a video that are used as `folder`/000123.jpg, by their number.

    Returns:
        What was found: frames, seconds, kept, size.

    Raises:
        SceneError: If the video cannot be read, is too short, or does not move.
    """
    scores, seconds = _scores(video)
    count = len(scores.sharpness)
    way = float(scores.motion.sum())
    chosen = choose_frames(scores, count_max=config.count_max, step=_STEP) if count else np.array([], np.int64)
    if count < FRAMES_MIN or seconds < 2.0:
        raise SceneError(f"{video.name} has {count} frames, {seconds:.1f} s: film the place for half a minute or more.")
    if way < _WAY_MIN:
        raise SceneError(
            f"{video.name}: the picture moves by {100 * way:.0f} % of its width in {seconds:.0f} s. A camera that "
            "stands still shows no depth: walk through the place while you film."
        )
    if len(chosen) < FRAMES_MIN:
        raise SceneError(
            f"{video.name} gives {len(chosen)} sharp frames from places apart, {FRAMES_MIN} are needed: "
            "film longer, walk slowly, with more light."
        )
    wanted = set(chosen.tolist())
    size = (0, 0)
    for number, bgr in enumerate(_frames(video)):
        if number in wanted:
            bgr = shrunk(bgr, config.side_max_px)
            size = (bgr.shape[1], bgr.shape[0])
            write_jpeg(folder / f"{number:06d}.jpg", bgr)
        if number >= chosen[-1]:
            break
    return {"frames": count, "seconds": round(seconds, 2), "kept": len(chosen), "size_px": list(size)}


def shrunk(bgr: UInt8Array, side_max_px: int) -> UInt8Array:
    """An image (H, W, 3) whose longer side has at most so many pixels."""
    share = side_max_px / max(bgr.shape[:2])
    if share >= 1.0:
        return bgr
    size = (round(bgr.shape[1] * share), round(bgr.shape[0] * share))
    return np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def write_jpeg(path: Path, bgr: UInt8Array) -> None:
    """Write an image (H, W, 3).

    Raises:
        OSError: If it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    path.write_bytes(data.tobytes())


def _scores(video: Path) -> tuple[FrameScores, float]:
    """Scores of all frames, and the seconds that they last."""
    sharp, moved, before = [], [], None
    for bgr in _frames(video):
        now = small_grey(bgr)
        sharp.append(sharpness(bgr))
        moved.append(0.0 if before is None else motion(before, now))
        before = now
    rate_hz = _open_video(video).get(cv2.CAP_PROP_FPS) or 30.0
    return FrameScores(sharpness=np.array(sharp), motion=np.array(moved)), len(sharp) / rate_hz


def _frames(video: Path) -> Iterator[UInt8Array]:
    """All frames, turned as the video says that it was held."""
    capture = _open_video(video)
    try:
        while True:
            there, bgr = capture.read()
            if not there:
                return
            yield bgr
    finally:
        capture.release()


def _open_video(video: Path) -> Any:
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        raise SceneError(f"{video} cannot be read as a video; convert it, for example to H.264 in .mp4.")
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture
