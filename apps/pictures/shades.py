"""Recorded images of any kind as colours for people to look at."""

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import HUMANS
from readygo.common.images.names import kind_of

NEAREST_M, FARTHEST_M = 0.3, 10.0
"""Depths are told apart between these, by their logarithm [m]."""


def shaded(image: npt.NDArray[Any], name: str) -> Picture:
    """An image in colours: depths bright where they are near and black where nothing is measured.

    Args:
        image: As `Dataset.decode_output` gives it, shape (H, W) or (H, W, 3).
        name: Of the image, see `readygo.common.images.names`.

    Returns:
        sRGB, shape (H, W, 3).
    """
    return _SHADES[kind_of(name)](image)


def _depth(depth_m: npt.NDArray[Any]) -> Picture:
    known = np.isfinite(depth_m) & (depth_m > 0)
    metres = np.clip(np.where(known, depth_m, FARTHEST_M), NEAREST_M, FARTHEST_M)
    near = np.log(FARTHEST_M / metres) / np.log(FARTHEST_M / NEAREST_M)
    colours = cv2.applyColorMap(np.rint(255 * near).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(known[..., None], colours, 0).astype(np.uint8)


def _mask(mask: npt.NDArray[Any]) -> Picture:
    colours = np.array([(0, 0, 0), *HUMANS], np.uint8)
    return np.asarray(colours[np.where(mask > 0, 1 + (mask.astype(int) - 1) % len(HUMANS), 0)], np.uint8)


def _grey(share: npt.NDArray[Any]) -> Picture:
    return np.repeat(np.rint(255 * share).astype(np.uint8)[..., None], 3, axis=2)


def _normal(normal: npt.NDArray[Any]) -> Picture:
    return np.asarray(np.rint(127.5 * (normal + 1.0)), np.uint8)


def _same(rgb: npt.NDArray[Any]) -> Picture:
    return rgb


_SHADES: Mapping[str, Callable[[npt.NDArray[Any]], Picture]] = {
    "rgb": _same,
    "depth": _depth,
    "median_depth": _depth,
    "alpha": _grey,
    "mask": _mask,
    "normal": _normal,
}
