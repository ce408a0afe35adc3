"""Films of pictures, which browsers play."""

import itertools
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.errors import ReadygoError
from readygo.common.files import write_then_rename
from readygo.common.robot.kinematics import RATE_HZ

CODECS = {".webm": ("VP80",), ".mp4": ("avc1", "vp09")}
"""What browsers play, by the ending of the file, the first that can be written. OpenCV's own builds lack H.264 (avc1);
VP9 then takes five times as long as VP8 in a .webm, and as many bytes."""
_LOG_ERRORS = cv2.utils.logging.LOG_LEVEL_ERROR
_INSTALL = "install opencv-python-headless from PyPI"


def write_film(path: Path, frames: Iterable[UInt8Array], *, fps: float = RATE_HZ) -> None:
    """Write a film: VP8 in a .webm, which is quick, or H.264 in a .mp4, VP9 where OpenCV lacks that.

    Args:
        path: File to write; it appears under this name only when it is complete.
        frames: One or more pictures of one even size, shape (H, W, 3).
        fps: Pictures per second; by default the simulation's rate.

    Raises:
        ReadygoError: If the ending is neither .webm nor .mp4, the file cannot be written, or this OpenCV cannot write
            films.
    """
    codecs = CODECS.get(path.suffix.lower())
    if codecs is None:
        raise ReadygoError(f"{path} must end in {' or '.join(CODECS)} to be a film.")
    pictures = iter(frames)
    first = next(pictures)
    with write_then_rename(path) as part:
        writer, count = _writer(part, codecs, (first.shape[1], first.shape[0]), fps), 0
        # What it cannot write raises nothing and is logged for every picture: it is seen below.
        level = cv2.utils.logging.setLogLevel(_LOG_ERRORS)
        try:
            for picture in itertools.chain([first], pictures):
                writer.write(np.ascontiguousarray(picture[:, :, ::-1]))
                count += 1
        finally:
            writer.release()
            cv2.utils.logging.setLogLevel(level)
        with _quiet_libraries():
            held = _pictures_in(part)
        if held < count:
            raise ReadygoError(f"{path} cannot be written: {held} of {count} pictures are in it. Is the disk full?")


def _pictures_in(path: Path) -> int:
    """How many pictures of a film can be played."""
    capture, count = cv2.VideoCapture(str(path)), 0
    while capture.grab():
        count += 1
    capture.release()
    return count


def _writer(path: Path, codecs: Iterable[str], size: tuple[int, int], fps: float) -> Any:
    for codec in codecs:
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
