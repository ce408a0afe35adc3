"""Smooth human paths: a clamped uniform cubic B-spline, optimised against an obstacle distance field.

J = w_o mean(max(0, d - clearance)^2) + w_j sum |third difference|^2 + w_l sum |first difference|^2 over the control
points, minimised with L-BFGS. Loops over scalars only: the result may not depend on a BLAS or the width of vectors.
Sources: Nocedal & Wright, Numerical Optimization, 2nd ed., algorithm 7.4; de Boor, A Practical Guide to Splines.
"""

from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame
from readygo.services.planner.humans.polyline import length_m, resample

SAMPLES_PER_POINT = 5
_MEMORY = 8


class Energy(NamedTuple):
    """What J is made of besides the control points."""

    first: Int64Array
    """First control point of each sample, shape (S,)."""
    weights: Float64Array
    """Weights of four control points at each sample, shape (S, 4)."""
    clearance_m: Float64Array
    """Distance to obstacles at cell centres [m], shape (H, W)."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float
    preferred_m: float
    """Below this distance obstacles push [m]."""
    obstacle: float
    """Weights of obstacles, jerk and length."""
    jerk: float
    length: float


@kernel_with_cache
def spline_basis(point_count: int, sample_count: int) -> tuple[Int64Array, Float64Array]:
    """First control point (S,) and weights (S, 4) of samples along a clamped uniform cubic B-spline."""
    first = np.empty(sample_count, np.int64)
    weights = np.zeros((sample_count, 4))
    spans = point_count - 3
    left, right = np.zeros(4), np.zeros(4)
    for s in range(sample_count):
        u = s * spans / (sample_count - 1)
        span = min(int(u), spans - 1)
        first[s] = span
        row = weights[s]
        row[0] = 1.0
        for k in range(1, 4):
            left[k] = u - max(0, span + 1 - k)
            right[k] = min(spans, span + k) - u
            carry = 0.0
            for r in range(k):
                part = row[r] / (right[r + 1] + left[k - r])
                row[r] = carry + right[r + 1] * part
                carry = left[k - r] * part
            row[k] = carry
    return first, weights


@kernel_with_cache
def spline_points(control: Float64Array, first: Int64Array, weights: Float64Array) -> Float64Array:
    """Points of a spline, shape (S, 2)."""
    points = np.zeros((len(first), 2))
    for s in range(len(first)):
        for k in range(4):
            for axis in range(2):
                points[s, axis] += weights[s, k] * control[first[s] + k, axis]
    return points


@kernel_with_cache
def distance_at(clearance: Float64Array, x_cells: float, y_cells: float) -> tuple[float, float, float]:
    """Bilinear distance [m] and its derivatives per cell, at a point in cell units (cell centres at +0.5)."""
    height, width = clearance.shape
    fx = min(max(x_cells - 0.5, 0.0), width - 1.001)
    fy = min(max(y_cells - 0.5, 0.0), height - 1.001)
    i, j = int(fy), int(fx)
    a, b = fx - j, fy - i
    v00, v01 = clearance[i, j], clearance[i, j + 1]
    v10, v11 = clearance[i + 1, j], clearance[i + 1, j + 1]
    value = (1 - b) * ((1 - a) * v00 + a * v01) + b * ((1 - a) * v10 + a * v11)
    return value, (1 - b) * (v01 - v00) + b * (v11 - v10), (1 - a) * (v10 - v00) + a * (v11 - v01)


@kernel_with_cache
def smallest_distance(points: Float64Array, clearance: Float64Array, ox: float, oy: float, resolution: float) -> float:
    """Smallest bilinear distance to an obstacle along points [m]."""
    best = np.inf
    for s in range(len(points)):
        value, _, _ = distance_at(clearance, (points[s, 0] - ox) / resolution, (points[s, 1] - oy) / resolution)
        best = min(best, value)
    return best


@kernel_with_cache
def _objective(control: Float64Array, energy: Energy, gradient: Float64Array) -> float:
    """J of the control points (n, 2); fills its gradient, 0 at both ends."""
    first, weights, clearance, ox, oy, resolution, preferred, obstacle, jerk, length = energy
    n, samples = len(control), len(first)
    gradient[:] = 0.0
    total = 0.0
    for s in range(samples):
        x, y = 0.0, 0.0
        for k in range(4):
            x += weights[s, k] * control[first[s] + k, 0]
            y += weights[s, k] * control[first[s] + k, 1]
        value, gx, gy = distance_at(clearance, (x - ox) / resolution, (y - oy) / resolution)
        if value < preferred:
            lack = preferred - value
            total += obstacle * lack * lack / samples
            pull = -2.0 * obstacle * lack / (samples * resolution)
            for k in range(4):
                gradient[first[s] + k, 0] += pull * gx * weights[s, k]
                gradient[first[s] + k, 1] += pull * gy * weights[s, k]
    for axis in range(2):
        for i in range(n - 3):
            d = control[i + 3, axis] - 3 * control[i + 2, axis] + 3 * control[i + 1, axis] - control[i, axis]
            total += jerk * d * d
            gradient[i, axis] -= 2 * jerk * d
            gradient[i + 1, axis] += 6 * jerk * d
            gradient[i + 2, axis] -= 6 * jerk * d
            gradient[i + 3, axis] += 2 * jerk * d
        for i in range(n - 1):
            d = control[i + 1, axis] - control[i, axis]
            total += length * d * d
            gradient[i, axis] -= 2 * length * d
            gradient[i + 1, axis] += 2 * length * d
    gradient[0] = 0.0
    gradient[n - 1] = 0.0
    return total


@kernel_with_cache
def _dot(a: Float64Array, b: Float64Array) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            total += a[i, k] * b[i, k]
    return total


@kernel_with_cache
def _direction(
    gradient: Float64Array, steps: Float64Array, changes: Float64Array, rho: Float64Array, count: int
) -> Float64Array:
    """Two-loop recursion: minus the inverse Hessian's estimate times the gradient."""
    direction = -gradient
    kept = min(count, _MEMORY)
    alpha = np.zeros(_MEMORY)
    for back in range(kept):
        j = (count - 1 - back) % _MEMORY
        alpha[j] = rho[j] * _dot(steps[j], direction)
        direction -= alpha[j] * changes[j]
    if kept > 0:
        j = (count - 1) % _MEMORY
        direction *= 1.0 / (rho[j] * _dot(changes[j], changes[j]))
    else:
        direction *= 0.05 / max(1e-9, np.abs(gradient).max())
    for back in range(kept - 1, -1, -1):
        j = (count - 1 - back) % _MEMORY
        beta = rho[j] * _dot(changes[j], direction)
        direction += (alpha[j] - beta) * steps[j]
    return direction


@kernel_with_cache
def optimise(control: Float64Array, energy: Energy, iterations: int) -> Float64Array:
    """Control points (n, 2) [m] that minimise J, the two ends fixed."""
    x = control.copy()
    gradient, trial_gradient = np.empty_like(x), np.empty_like(x)
    steps, changes = np.zeros((_MEMORY, *x.shape)), np.zeros((_MEMORY, *x.shape))
    rho = np.zeros(_MEMORY)
    count = 0
    value = _objective(x, energy, gradient)
    for _ in range(iterations):
        direction = _direction(gradient, steps, changes, rho, count)
        slope = _dot(gradient, direction)
        if slope > -1e-12:
            break
        largest = np.abs(direction).max()
        scale = min(1.0, 0.3 / largest)
        trial, trial_value, accepted = x, value, False
        for _attempt in range(12):
            trial = x + scale * direction
            trial_value = _objective(trial, energy, trial_gradient)
            if trial_value <= value + 1e-4 * scale * slope:
                accepted = True
                break
            scale *= 0.5
        if not accepted:
            break
        curvature = _dot(trial - x, trial_gradient - gradient)
        if curvature > 1e-12:
            j = count % _MEMORY
            steps[j], changes[j], rho[j] = trial - x, trial_gradient - gradient, 1.0 / curvature
            count += 1
        gain = value - trial_value
        x, value = trial, trial_value
        gradient[:] = trial_gradient
        if gain < 1e-6 * max(1.0, value):
            break
    return x


def smooth_path(
    route_m: Float64Array,
    clearance: Float64Array,
    frame: GridFrame,
    *,
    spacing_m: float,
    preferred_m: float,
    required_m: float,
    factors: tuple[float, float, float],
    iterations: int,
) -> Float64Array | None:
    """A smooth path along a route.

    Args:
        route_m: Polyline from start to end [m], shape (N, 2).
        clearance: Distance to obstacles at cell centres [m], shape (H, W).
        frame: Where the cells lie.
        spacing_m: Distance of the control points [m]; between 8 and 60 of them.
        preferred_m: Below this distance obstacles push [m].
        required_m: No point may be nearer to an obstacle [m].
        factors: Weights of obstacles, jerk and length; the first grows up to 125 times where `required_m` fails.
        iterations: L-BFGS iterations per weight.

    Returns:
        Points [m], shape (5 n, 2), or None if no path keeps `required_m`.
    """
    count = int(min(max(length_m(route_m) / spacing_m, 8), 60))
    first, weights = spline_basis(count, count * SAMPLES_PER_POINT)
    place = (clearance, frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    energy = Energy(first, weights, *place, preferred_m, *factors)
    control = resample(route_m, count)
    for _ in range(4):
        control = optimise(control, energy, iterations)
        points: Float64Array = spline_points(control, first, weights)
        if smallest_distance(points, *place) >= required_m:
            return points
        energy = energy._replace(obstacle=5.0 * energy.obstacle)
    return None
