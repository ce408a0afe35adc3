"""Films of pictures: MP4 files, and animations for pages."""

import itertools
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.drawing.files import Picture
from readygo.common.errors import ReadygoError
from readygo.common.files import unfinished
from readygo.common.robot.kinematics import DT_S, RATE_HZ

# Browsers play H.264; OpenCV's own builds often lack its encoder, but all write MPEG-4 part 2.
CODECS = ("avc1", "mp4v")
ANIMATION_QUALITY = 60
ANIMATION_END_MS = 1500
_INSTALL = "install opencv-python-headless from PyPI"


def write_film(path: Path, frames: Iterable[Picture], *, fps: int = RATE_HZ) -> None:
    """Write an MP4.

    Args:
        path: File to write; it appears under this name only when it is complete.
        frames: One or more pictures of one even size, shape (H, W, 3).
        fps: Pictures per second; by default the simulation's rate.

    Raises:
        ReadygoError: If the file cannot be written, or this OpenCV cannot write videos.
    """
    pictures = iter(frames)
    first = next(pictures)
    with unfinished(path) as part:
        writer = _writer(part, (first.shape[1], first.shape[0]), fps)
        try:
            for picture in itertools.chain([first], pictures):
                writer.write(np.ascontiguousarray(picture[:, :, ::-1]))
        finally:
            writer.release()
        if not part.exists() or part.stat().st_size == 0:
            raise ReadygoError(f"OpenCV {cv2.__version__} cannot write {path}; {_INSTALL}.")


def write_animation(path: Path, frames: Iterable[Picture], *, step: int = 1) -> None:
    """Write an animated WebP, which browsers play inside of a page, at the simulation's pace.

    Args:
        path: File to write; it appears under this name only when it is complete.
        frames: Pictures of one size, shape (H, W, 3).
        step: Simulation steps between two pictures.

    Raises:
        ReadygoError: If the file cannot be written, or this OpenCV cannot write animations.
    """
    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(frame[..., ::-1]) for frame in frames]
    durations_ms = [round(1000 * DT_S * step)] * len(animation.frames)
    # The end stays on for a moment before the film begins anew.
    durations_ms[-1] = ANIMATION_END_MS
    animation.durations = durations_ms
    with unfinished(path) as part:
        if not cv2.imwriteanimation(str(part), animation, [cv2.IMWRITE_WEBP_QUALITY, ANIMATION_QUALITY]):
            raise ReadygoError(f"OpenCV {cv2.__version__} cannot write {path}; {_INSTALL}.")


def _writer(path: Path, size: tuple[int, int], fps: int) -> Any:
    for codec in CODECS:
        with _quiet_libraries():
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, size)
        if writer.isOpened():
            return writer
    raise ReadygoError(f"OpenCV {cv2.__version__} cannot write videos; {_INSTALL}.")


@contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Keep FFmpeg from reporting on stderr that an encoder is missing: another one follows."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
