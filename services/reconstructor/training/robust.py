"""Which pixels of a photo are believed: things that pass by are in one photo and not in the scene.

They differ from what is drawn by much more than the rest of the photo does, and in patches. So the pixels with the
largest smoothed differences are left out, a limited share of each photo, and none that is near the usual difference.

Source: the trimmed loss of RobustNeRF (Sabour et al., 2023) and SpotLessSplats (Sabour et al., 2024) without features;
the limit relative to the median is ours: it keeps photos whole in which nothing passes by.
"""

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float32Array

_PATCH = 0.02
"""Differences are smoothed over this share of the photo's longer side."""
_TIMES_MEDIAN, _DIFFERENCE_MIN = 3.0, 0.04
"""What differs by less than so many times the photo's median, or by less than this of the range, is believed."""


def trusted_pixels(image: Float32Array, photo: Float32Array, trim: float, mask: BoolArray | None = None) -> BoolArray:
    """True where a photo is believed, shape (H, W).

    Args:
        image: What is drawn, with the photo's exposure, in 0..1, shape (3, H, W).
        photo: The photo, shape (3, H, W).
        trim: At most about this share of the pixels is left out.
        mask: True where the photo counts; None where all of it does. What does not count is not believed either.
    """
    counts = np.ones(photo.shape[1:], np.bool_) if mask is None else mask
    if not counts.any():
        return counts
    difference = np.abs(np.clip(image, 0.0, 1.0) - photo).mean(axis=0) * counts
    patch = 2 * round(0.5 * _PATCH * max(photo.shape[1:])) + 1
    # The mean over pixels that count.
    weight = np.maximum(cv2.blur(counts.astype(np.float32), (patch, patch)), 1e-6)
    smooth = cv2.blur(difference.astype(np.float32), (patch, patch)) / weight
    usual = float(np.median(smooth[counts]))
    limit = max(float(np.quantile(smooth[counts], 1.0 - trim)), _TIMES_MEDIAN * usual, _DIFFERENCE_MIN)
    trusted: BoolArray = counts & (smooth <= limit)
    return trusted
