"""Depths as colours for display."""

import cv2
import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array

NEAREST_M, FARTHEST_M = 0.3, 10.0
"""Range of depths with different brightness, on a logarithmic scale [m]."""


def shade_depth(depth_m: AnyArray) -> UInt8Array:
    """Depths, bright where they are near and black where nothing is measured.

    Args:
        depth_m: Depths [m], shape (H, W); non-finite or 0 where nothing was measured.

    Returns:
        sRGB, shape (H, W, 3).
    """
    known = np.isfinite(depth_m) & (depth_m > 0)
    metres = np.clip(np.where(known, depth_m, FARTHEST_M), NEAREST_M, FARTHEST_M)
    near = np.log(FARTHEST_M / metres) / np.log(FARTHEST_M / NEAREST_M)
    colours = cv2.applyColorMap(np.rint(255 * near).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(known[..., None], colours, 0).astype(np.uint8)
