"""Polylines: their lengths, and points along them."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache


def resample(points_m: Float64Array, count: int) -> Float64Array:
    """`count` points at equal distances along a polyline, ends included, shape (count, 2)."""
    return at_lengths(points_m, np.linspace(0.0, length_m(points_m), count))


def at_constant_speed(points_m: Float64Array, speed_mps: float, dt_s: float) -> Float64Array:
    """Positions of a human who walks a polyline at one speed [m], shape (T, 2); the last one is the end."""
    total_m = length_m(points_m)
    count = int(total_m / (speed_mps * dt_s)) + 2
    return at_lengths(points_m, np.minimum(np.arange(count) * (speed_mps * dt_s), total_m))


def length_m(points_m: Float64Array) -> float:
    """Length of a polyline [m]."""
    return float(_lengths(points_m)[-1])


@kernel_with_cache
def _lengths(points_m: Float64Array) -> Float64Array:
    lengths = np.zeros(len(points_m))
    for k in range(1, len(points_m)):
        dx, dy = points_m[k, 0] - points_m[k - 1, 0], points_m[k, 1] - points_m[k - 1, 1]
        lengths[k] = lengths[k - 1] + math.sqrt(dx * dx + dy * dy)
    return lengths


def at_lengths(points_m: Float64Array, lengths_m: Float64Array) -> Float64Array:
    """Points at distances along a polyline [m], shape (len(lengths_m), 2); its ends are held."""
    along = _lengths(points_m)
    return np.stack([np.interp(lengths_m, along, points_m[:, k]) for k in range(2)], axis=1)
