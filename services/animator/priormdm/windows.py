"""Long motions from a model of short ones: overlapping windows that agree at every diffusion step.

The model predicts every window; where windows overlap, their predictions fade into each other. All of them denoise one
motion, so nothing has to be joined afterwards. The features are relative to the person, so windows need no alignment.

Source of the idea: Bar-Tal et al., MultiDiffusion, 2023; compare DoubleTake of Shafir et al., 2024.
"""

from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.services.animator.priormdm.diffusion import Predict

WINDOW = 196
"""Frames of the model's training: 9.8 s."""

PredictBatch = Callable[[Float32Array, int], Float32Array]
"""Noisy windows (B, W, 263) and a trained step -> clean windows (B, W, 263)."""


def window_starts(count: int, overlap: int, window: int = WINDOW) -> list[int]:
    """First frames of the windows that cover `count` frames; the last window ends with the last frame.

    Args:
        count: Frames, at least `window`.
        overlap: Frames that neighbours share at least.
        window: Frames of a window.
    """
    if count < window or not 0 < overlap < window:
        raise ValueError(f"{count} frames with an overlap of {overlap} do not fill windows of {window} frames.")
    starts = list(range(0, count - window, window - overlap))
    return [*starts, count - window]


def fade_weights(count: int, starts: list[int], overlap: int, window: int = WINDOW) -> Float64Array:
    """Weight of every window at every of its frames, shape (B, W); the weights of a frame sum to 1."""
    ramp = np.minimum(np.arange(1, window + 1), np.arange(window, 0, -1)) / (overlap + 1)
    weights = np.tile(np.minimum(ramp, 1.0), (len(starts), 1))
    total = np.zeros(count)
    for start, weight in zip(starts, weights, strict=True):
        total[start : start + window] += weight
    for start, weight in zip(starts, weights, strict=True):
        weight /= total[start : start + window]
    return weights


def over_windows(predict: PredictBatch, count: int, overlap: int) -> Predict:
    """A predictor for motions of `count` frames from one for windows."""
    starts = window_starts(count, overlap)
    weights = fade_weights(count, starts, overlap).astype(np.float32)[..., None]

    def whole(x: Float32Array, step: int) -> Float32Array:
        parts = predict(np.stack([x[start : start + WINDOW] for start in starts]), step)
        clean = np.zeros_like(x)
        for start, part, weight in zip(starts, parts, weights, strict=True):
            clean[start : start + WINDOW] += weight * part
        return clean

    return whole
