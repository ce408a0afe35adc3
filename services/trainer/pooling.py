"""Images made smaller by whole factors, as networks take them."""

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.camera import CameraConfig


def pooling_of(camera: CameraConfig, pooled_height_px: int) -> int:
    """The largest whole factor that divides a camera's image and leaves the height; 1 for a height of 0."""
    if pooled_height_px == 0:
        return 1
    height, width = camera.height_px, camera.width_px
    factors = range(1, max(1, height // pooled_height_px) + 1)
    return max(factor for factor in factors if height % factor == 0 and width % factor == 0)


def thin_pixels(depth: UInt8Array, factor: int) -> UInt8Array:
    """The pixel in the middle of every square of `factor` pixels: a mean of depths is where nothing is."""
    return depth[factor // 2 :: factor, factor // 2 :: factor]


def pool(frame: UInt8Array, factor: int) -> UInt8Array:
    """The mean of every square of `factor` pixels, halves rounded up, shape (H / factor, W / factor, 3)."""
    if factor == 1:
        return frame
    if factor == 2:
        # OpenCV rounds this one as said, and is ten times faster.
        return np.asarray(cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
    height, width = frame.shape[0] // factor, frame.shape[1] // factor
    sums = frame.reshape(height, factor, width, factor, 3).sum(axis=(1, 3), dtype=np.uint32)
    pooled: UInt8Array = ((2 * sums + factor * factor) // (2 * factor * factor)).astype(np.uint8)
    return pooled
