"""Camera images as the published networks know them."""

from collections.abc import Sequence

import numpy as np
import torch

from readygo.common.arrays import UInt8Array

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of the colours of ImageNet's images, 0..1."""
ASPECT = 4 / 3
"""Aspect ratio of the images that the networks learned from; wider images lose their sides."""


def small_image(image: UInt8Array, width_px: int, height_px: int) -> torch.Tensor:
    """The middle of an image at a network's size.

    Args:
        image: sRGB image, shape (H, W, 3).
        width_px: Width of the result [px].
        height_px: Height of the result [px].

    Returns:
        Values 0..1, shape (3, height, width).
    """
    height, width = image.shape[:2]
    kept = min(width, round(height * ASPECT))
    left = (width - kept) // 2
    pixels = torch.from_numpy(image[:, left : left + kept].astype(np.float32)).permute(2, 0, 1)[None] / 255
    size = (height_px, width_px)
    return torch.nn.functional.interpolate(pixels, size, mode="bicubic", antialias=True).clamp(0, 1)[0]


def normalise_images(images: torch.Tensor) -> torch.Tensor:
    """Images of values 0..1, shape (..., 3, H, W), as the networks take them."""
    return (images - _channels(MEAN)) / _channels(STD)


def _channels(values: Sequence[float]) -> torch.Tensor:
    return torch.tensor(values)[:, None, None]
