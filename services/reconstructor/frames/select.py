"""Which frames of a video are worth keeping: sharp ones, spread evenly over how the picture moves."""

from dataclasses import dataclass

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, Int64Array, UInt8Array

_WIDTH_PX = 320
"""Frames are judged at this width [px]."""
_CORNERS = 200
_BLURRED = 0.4
"""A frame with less of its neighbours' sharpness than this share is blurred."""
_NEIGHBOURS = 15


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameScores:
    """What is known of every frame of a video."""

    sharpness: Float64Array
    """Contrast of the finest details over that of the picture, shape (N,)."""
    motion: Float64Array
    """Median way of the picture since the frame before, as share of its width, shape (N,)."""


def small_grey(bgr: UInt8Array) -> UInt8Array:
    """An image (H, W, 3) as it is judged."""
    height = max(1, round(bgr.shape[0] * _WIDTH_PX / bgr.shape[1]))
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.resize(grey, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def sharpness(bgr: UInt8Array) -> float:
    """Standard deviation of the Laplacian over that of the image: blur lowers it, light does not change it."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    if grey.shape[1] > 2 * _WIDTH_PX:
        grey = cv2.resize(grey, None, fx=2 * _WIDTH_PX / grey.shape[1], fy=2 * _WIDTH_PX / grey.shape[1],
                          interpolation=cv2.INTER_AREA)  # fmt: skip
    return float(cv2.Laplacian(grey, cv2.CV_32F).std() / (grey.std() + 1.0))


def motion(before: UInt8Array, now: UInt8Array, *, share: float = 0.5) -> float:
    """Way of corners from one small frame to another, as share of the width; 0 where there are none.

    Args:
        before: One frame, shape (H, W).
        now: The other one, shape (H, W).
        share: So many corners move less; half of them gives the median.
    """
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.01, 7)
    if corners is None:
        return 0.0
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, now, corners, np.empty_like(corners))
    way_px = np.linalg.norm((moved - corners).reshape(-1, 2)[found.ravel() == 1], axis=1)
    # Lost corners mean that the picture changed a lot.
    return float(np.quantile(way_px, share)) / before.shape[1] if 2 * len(way_px) > len(corners) else 0.25


def choose_frames(scores: FrameScores, *, count_max: int, step: float) -> Int64Array:
    """Numbers of the frames to keep, in order.

    The video is cut where the picture has moved by `step`, or by more where that gives too many; of each part the
    sharpest frame is kept, unless it is blurred beside its neighbours.

    Args:
        scores: Of every frame.
        count_max: How many may be kept.
        step: Way of the picture from one to the next, as share of its width.
    """
    way = np.cumsum(scores.motion)
    parts = int(np.clip(np.ceil(way[-1] / step), 1, count_max))
    part_of = np.minimum((way / max(way[-1], 1e-12) * parts).astype(np.int64), parts - 1)
    # Within each part, from sharp to blurred; the first of each part is its best.
    order = np.lexsort((-scores.sharpness, part_of))
    best = order[np.unique(part_of[order], return_index=True)[1]]
    usual = np.array([np.median(scores.sharpness[max(0, i - _NEIGHBOURS) : i + _NEIGHBOURS + 1]) for i in best])
    return np.sort(best[scores.sharpness[best] >= _BLURRED * usual])
