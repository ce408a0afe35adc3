"""How much an image differs from a photo, (1 - w) L1 + w (1 - SSIM), with its derivative, and what is measured on it.

SSIM: windows of 11x11 pixels, Gaussian with a standard deviation of 1.5, zeros beyond the border, the mean over pixels
and channels. Source: Wang et al., Image Quality Assessment: From Error Visibility to Structural Similarity, 2004.
"""

import math
from typing import Any

import numpy as np
import torch

from readygo.common.arrays import Float32Array
from readygo.common.kernels import kernel_with_cache

SSIM_WEIGHT = 0.2
"""The share w of 3DGS (Kerbl et al., 2023)."""
TAPS = 11
_SIGMA_PX, _C1, _C2 = 1.5, 0.01**2, 0.03**2
_SUMS, _PARTS = 5, 3
"""Filtered images of a channel: x, y, xx, yy, xy; and derivatives by the filtered x, xx and xy."""


def _window() -> Float32Array:
    offsets = np.arange(TAPS) - TAPS // 2
    weights = np.exp(-0.5 * (offsets / _SIGMA_PX) ** 2)
    window: Float32Array = (weights / weights.sum()).astype(np.float32)
    return window


WINDOW = _window()


class Photometric:
    """The loss of images of one size, and its memory. One for each thread."""

    def __init__(self, height_px: int, width_px: int) -> None:
        self._rows = np.zeros((_SUMS, height_px, width_px), dtype=np.float32)
        self._parts = np.empty((_PARTS, height_px, width_px), dtype=np.float32)
        self._padded = np.zeros((_SUMS, width_px + TAPS - 1), dtype=np.float32)

    def __call__(
        self, image: Float32Array, photo: Float32Array, ssim_weight: float
    ) -> tuple[float, float, Float32Array]:
        """The loss of an image.

        Args:
            image: In 0..1, shape (3, H, W).
            photo: The same of the photo.
            ssim_weight: The weight w.

        Returns:
            The loss, the SSIM, and the loss's derivative by the image.
        """
        slope = np.empty_like(image)
        absolute, similarity = 0.0, 0.0
        for x, y, out in zip(image, photo, slope, strict=True):
            similarity += _ssim(x, y, WINDOW, self._padded, self._rows, self._parts, out)
            absolute += _add_l1(x, y, ssim_weight, image.size, out)
        ssim = similarity / image.size
        return (1.0 - ssim_weight) * absolute / image.size + ssim_weight * (1.0 - ssim), ssim, slope


def photometric_loss(image: torch.Tensor, photo: torch.Tensor, ssim_weight: float) -> torch.Tensor:
    """The photometric loss for torch to derive, on any device.

    The window is a product of two banded matrices: no convolution, which may round to TF32 on a GPU.

    Args:
        image: In 0..1, shape (3, H, W).
        photo: The same of the photo.
        ssim_weight: The weight w.
    """
    down, across = _band(image.shape[1], image), _band(image.shape[2], image)
    x, y, xx, yy, xy = down @ torch.stack([image, photo, image * image, photo * photo, image * photo]) @ across
    numerator = (2.0 * x * y + _C1) * (2.0 * (xy - x * y) + _C2)
    ssim = numerator / ((x * x + y * y + _C1) * (xx - x * x + yy - y * y + _C2))
    loss: torch.Tensor = (1.0 - ssim_weight) * (image - photo).abs().mean() + ssim_weight * (1.0 - ssim.mean())
    return loss


def _band(side_px: int, like: torch.Tensor) -> torch.Tensor:
    """The window around every pixel of a line, a row each, shape (n, n)."""
    numbers = torch.arange(side_px, device=like.device)
    taps = numbers[None] - numbers[:, None] + TAPS // 2
    weights = torch.from_numpy(WINDOW).to(like)[taps.clamp(0, TAPS - 1)]
    return torch.where((taps >= 0) & (taps < TAPS), weights, 0.0)


def psnr_db(image: Float32Array, photo: Float32Array) -> float:
    """Peak signal-to-noise ratio of an image in 0..1 [dB]."""
    error = float(np.mean(np.square(np.clip(image, 0.0, 1.0) - photo, dtype=np.float64)))
    return -10.0 * math.log10(max(error, 1e-12))


def fit_colours(image: Float32Array, photo: Float32Array) -> Float32Array:
    """The image after the affine map of its colours that fits the photo best, by least squares.

    Exposure and white balance of a held-out photo are unknown; such a map takes out what they change.

    Args:
        image: In 0..1, shape (3, ...).
        photo: The same of the photo.

    Returns:
        Shape (3, ...), in 0..1.
    """
    colours = np.concatenate([image.reshape(3, -1), np.ones((1, image[0].size))]).astype(np.float64)
    # Colours of a grey image are one and the same: then the smallest of all solutions is taken.
    matrix, *_ = np.linalg.lstsq(colours @ colours.T, colours @ photo.reshape(3, -1).T.astype(np.float64), rcond=1e-9)
    fitted = (matrix.T @ colours).reshape(image.shape)
    return np.clip(fitted, 0.0, 1.0).astype(np.float32)


@kernel_with_cache(error_model="numpy", nogil=True)
def _filter_row(padded: Float32Array, w: Float32Array, out: Float32Array) -> None:
    """Filter a row that has five zeros on either side."""
    w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
    n = len(out)
    for u in range(n):
        out[u] = (
            w0 * (padded[u] + padded[u + 10])
            + w1 * (padded[u + 1] + padded[u + 9])
            + w2 * (padded[u + 2] + padded[u + 8])
            + w3 * (padded[u + 3] + padded[u + 7])
            + w4 * (padded[u + 4] + padded[u + 6])
            + w5 * padded[u + 5]
        )


@kernel_with_cache(error_model="numpy", nogil=True)
def _filter_columns(rows: Float32Array, v: int, w: Float32Array, out: Float32Array) -> None:
    """Row v of an image whose columns are filtered; `out` may have more columns on the right."""
    height, width = rows.shape
    out[:width] = 0.0
    for tap in range(TAPS):
        source = v + tap - TAPS // 2
        if 0 <= source < height:
            weight, row = w[tap], rows[source]
            for u in range(width):
                out[u] += weight * row[u]


@kernel_with_cache(error_model="numpy", nogil=True)
def _ssim(
    x: Float32Array,
    y: Float32Array,
    w: Float32Array,
    padded: Float32Array,
    rows: Float32Array,
    parts: Float32Array,
    out: Float32Array,
) -> float:
    """Sum of SSIM over the pixels of a channel; `out` gets its derivative by x."""
    height, width = x.shape
    side = TAPS // 2
    padded[:] = 0.0
    for v in range(height):
        for u in range(width):
            a, b = x[v, u], y[v, u]
            padded[0, side + u], padded[1, side + u] = a, b
            padded[2, side + u], padded[3, side + u], padded[4, side + u] = a * a, b * b, a * b
        for k in range(_SUMS):
            _filter_row(padded[k], w, rows[k, v])
    total = 0.0
    for v in range(height):
        for k in range(_SUMS):
            _filter_columns(rows[k], v, w, padded[k])
        total += _pixels(padded, parts[0, v], parts[1, v], parts[2, v])
    padded[:] = 0.0
    for v in range(height):
        for k in range(_PARTS):
            padded[k, side : side + width] = parts[k, v]
            _filter_row(padded[k], w, rows[k, v])
    for v in range(height):
        for k in range(_PARTS):
            _filter_columns(rows[k], v, w, padded[k])
        for u in range(width):
            out[v, u] = padded[0, u] + np.float32(2) * x[v, u] * padded[1, u] + y[v, u] * padded[2, u]
    return total


@kernel_with_cache(error_model="numpy", nogil=True)
def _pixels(
    sums: Float32Array,
    by_mean: Float32Array,
    by_square: Float32Array,
    by_product: Float32Array,
) -> float:
    """Sum of SSIM over a row, and its derivatives by the filtered x, xx and xy."""
    c1, c2, one, two = np.float32(_C1), np.float32(_C2), np.float32(1), np.float32(2)
    x, y, xx, yy, xy = sums[0], sums[1], sums[2], sums[3], sums[4]
    for u in range(len(by_mean)):
        mean_x, mean_y = x[u], y[u]
        a1 = two * mean_x * mean_y + c1
        a2 = two * (xy[u] - mean_x * mean_y) + c2
        b1 = one / (mean_x * mean_x + mean_y * mean_y + c1)
        b2 = one / (xx[u] - mean_x * mean_x + yy[u] - mean_y * mean_y + c2)
        s = a1 * a2 * b1 * b2
        by_mean[u] = two * (mean_y * (a2 - a1) * b1 * b2 + s * mean_x * (b2 - b1))
        by_square[u] = -s * b2
        by_product[u] = two * a1 * b1 * b2
        xx[u] = s
    total = 0.0
    for u in range(len(by_mean)):
        total += xx[u]
    return total


@kernel_with_cache(error_model="numpy", nogil=True)
def _add_l1(x: Float32Array, y: Float32Array, ssim_weight: float, count: int, out: Float32Array) -> float:
    """Sum of absolute differences; `out` becomes the loss's derivative by x, from that of the sum of SSIM."""
    ssim, absolute = np.float32(-ssim_weight / count), np.float32((1.0 - ssim_weight) / count)
    total = 0.0
    for v in range(x.shape[0]):
        row: Any = np.float32(0)
        for u in range(x.shape[1]):
            d = x[v, u] - y[v, u]
            out[v, u] = ssim * out[v, u] + absolute * np.sign(d)
            row += abs(d)
        total += row
    return total
