"""Frames of a video that are evenly spaced in time, and whether the camera stood still meanwhile."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import Int64Array
from readygo.services.reconstructor.frames.select import motion, small_grey
from readygo.services.reconstructor.frames.video import cut_off, open_video, read_frames, turned_deg, write_jpeg

_COMPARED = 12
"""So many frames are compared with the first one."""
_BACKGROUND_SHARE = 0.1
"""At least this share of the picture's corners belongs to what stands behind the person: they move by at most 0.2 % of
the width where a simulated camera stands still, and by 1.9 % or more where it follows someone who walks."""
_RATE_UNKNOWN_HZ = 30.0


def extract_even_frames(video: Path, folder: Path, *, rate_hz: float, count_max: int) -> dict[str, Any]:
    """Write frames of a video as `folder`/000123.jpg, by their number, at their full size.

    Args:
        video: The video.
        folder: Where to write.
        rate_hz: About so many frames a second are taken, at most all.
        count_max: At most so many are taken, at a lower rate.

    Returns:
        `frames` of the video, `numbers` of those that are written, their `rate_hz`, `size_px` (width, height),
        `turned_deg` (by how much frames were turned clockwise to be upright), `moved` (way of the background, as a
        share of the width), `notes`.

    Raises:
        SceneError: If the video cannot be read.
    """
    times_s = _times_s(video)
    numbers, rate = even_frames(times_s, rate_hz=rate_hz, count_max=count_max)
    wanted, compared = set(numbers.tolist()), set(numbers[:: max(1, len(numbers) // _COMPARED)].tolist())
    first, size, ways = None, (0, 0), list[float]()
    for number, (bgr, _) in enumerate(read_frames(video)):
        if number in wanted:
            write_jpeg(folder / f"{number:06d}.jpg", bgr)
            size = (bgr.shape[1], bgr.shape[0])
        if number in compared:
            grey = small_grey(bgr)
            ways += [] if first is None else [motion(first, grey, share=_BACKGROUND_SHARE)]
            first = grey if first is None else first
    cut = cut_off(video)
    return {"frames": len(times_s), "numbers": numbers.tolist(), "rate_hz": round(rate, 3), "size_px": list(size),
            "turned_deg": turned_deg(video), "moved": float(np.median(ways)) if ways else 0.0,
            "notes": [f"{cut}; its first {len(times_s)} frames are used"] if cut else []}  # fmt: skip


def even_frames(times_s: Sequence[float], *, rate_hz: float, count_max: int) -> tuple[Int64Array, float]:
    """Numbers of frames that are evenly spaced in time, and their rate [Hz].

    The spacing is a multiple of the usual one, so that frames at a constant rate are exactly even. Of frames at a
    variable rate the nearest ones are taken.

    Args:
        times_s: When frames begin, in order.
        rate_hz: Rate that is wanted.
        count_max: Most frames.
    """
    if len(times_s) < 2:
        return np.arange(len(times_s)), rate_hz
    times = np.asarray(times_s, dtype=np.float64)
    usual_s = float(np.median(np.diff(times)))
    count = round((times[-1] - times[0]) / usual_s) + 1
    spacing_s = usual_s * max(1, round(1.0 / (usual_s * rate_hz)), math.ceil(count / count_max))
    ticks = np.arange(times[0], times[-1] + 0.5 * usual_s, spacing_s)
    after = np.clip(np.searchsorted(times, ticks), 1, len(times) - 1)
    nearest = np.where(ticks - times[after - 1] < times[after] - ticks, after - 1, after)
    return np.unique(nearest), 1.0 / spacing_s


def _times_s(video: Path) -> list[float]:
    """When the frames of a video begin; where a file tells none, by its rate."""
    times_s = [time_s for _, time_s in read_frames(video)]
    if len(times_s) > 1 and np.median(np.diff(times_s)) > 0.0:
        return times_s
    rate_hz = open_video(video).get(cv2.CAP_PROP_FPS) or _RATE_UNKNOWN_HZ
    return [number / rate_hz for number in range(len(times_s))]
