"""Depths as colours for people to look at."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.drawing.files import Picture

NEAREST_M, FARTHEST_M = 0.3, 10.0
"""Depths are told apart between these, by their logarithm [m]."""


def shaded(depth_m: npt.NDArray[Any]) -> Picture:
    """Depths, bright where they are near and black where nothing is measured.

    Args:
        depth_m: Shape (H, W) [m]; what is not measured is not finite, or 0.

    Returns:
        sRGB, shape (H, W, 3).
    """
    known = np.isfinite(depth_m) & (depth_m > 0)
    metres = np.clip(np.where(known, depth_m, FARTHEST_M), NEAREST_M, FARTHEST_M)
    near = np.log(FARTHEST_M / metres) / np.log(FARTHEST_M / NEAREST_M)
    colours = cv2.applyColorMap(np.rint(255 * near).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(known[..., None], colours, 0).astype(np.uint8)
