"""Smooth extrapolation of a grid beyond the cells that are known."""

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array

_BLUR_PASSES = 4


def fill_smoothly(values: Float64Array, known: BoolArray) -> Float64Array:
    """Continue a grid into its unknown cells: coarser and coarser averages, then smoothed; known cells stay.

    Args:
        values: Grid, shape (H, W); unknown cells may hold anything, NaN too.
        known: Where `values` holds, shape (H, W), at least one cell.

    Returns:
        Grid without gaps, shape (H, W).
    """
    filled = _pull_push(np.where(known, values, 0.0), known.astype(np.float64))
    for _ in range(_BLUR_PASSES):
        filled = np.where(known, values, box_mean(filled))
    return filled


def box_mean(values: Float64Array) -> Float64Array:
    """Mean of the 3x3 cells around each cell; the border repeats."""
    padded = np.pad(values, 1, mode="edge")
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    mean: Float64Array = (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9.0
    return mean


def _pull_push(values: Float64Array, weights: Float64Array) -> Float64Array:
    if values.shape == (1, 1) or weights.all():
        return values
    height, width = values.shape
    even = ((0, height % 2), (0, width % 2))
    v, w = np.pad(values * weights, even), np.pad(weights, even)
    sums = v[::2, ::2] + v[1::2, ::2] + v[::2, 1::2] + v[1::2, 1::2]
    counts = w[::2, ::2] + w[1::2, ::2] + w[::2, 1::2] + w[1::2, 1::2]
    some = counts > 0
    coarse = _pull_push(np.where(some, sums / np.where(some, counts, 1.0), 0.0), some.astype(np.float64))
    return np.where(weights > 0, values, _double_grid(coarse)[:height, :width])


def _double_grid(values: Float64Array) -> Float64Array:
    """A grid of twice the size, linear between cell centres."""
    for axis in (0, 1):
        lower = np.concatenate([values.take([0], axis), values.take(range(values.shape[axis] - 1), axis)], axis)
        upper = np.concatenate([values.take(range(1, values.shape[axis]), axis), values.take([-1], axis)], axis)
        pair = np.stack([0.75 * values + 0.25 * lower, 0.75 * values + 0.25 * upper], axis + 1)
        shape = list(values.shape)
        shape[axis] *= 2
        values = pair.reshape(shape)
    return values
