"""Depth images as the stages of a job keep them, beside masks: `depth/NAME.png` of 16 bits, 0 where unmeasured."""

from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import FloatingArray, UInt16Array
from readygo.common.images.encoded import read_pixels

FOLDER = "depth"
STEP_M = 1e-3
"""Metres of a step."""
_STEPS_MAX = 65535


def to_steps(depth_m: FloatingArray) -> UInt16Array:
    """Depths [m] in steps; what is farther than steps reach is not measured."""
    steps = np.rint(depth_m / STEP_M)
    return np.where(steps <= _STEPS_MAX, steps, 0).astype(np.uint16)


def read_steps(path: Path) -> UInt16Array | None:
    """A depth image in steps, shape (H, W); None if there is no such file, or it is none that can be decoded."""
    pixels = read_pixels(path, cv2.IMREAD_UNCHANGED)
    return None if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2 else np.asarray(pixels)
