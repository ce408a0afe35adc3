"""A Kalman filter of a walking human: constant velocity, disturbed by white acceleration.

Legend: the state is x, y [m] and vx, vy [m/s] in the world, P its covariance, F the step of `dt`, q the spectral
density of the acceleration [m2/s3]:

    x' = F x,   P' = F P F^T + Q,   Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] on each axis

    K = P H^T (H P H^T + R)^-1,   x' = x + K (z - H x),   P' = (I - K H) P

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 6.2.2 and 5.2.
"""

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache

ACCELERATION_NOISE = 0.6
"""Spectral density of the acceleration of pedestrians [m2/s3]."""


@kernel_with_cache
def predict(mean: Float64Array, cov: Float64Array, dt_s: float, noise: float) -> None:
    """Move a state on.

    Args:
        mean: x, y [m], vx, vy [m/s], shape (4,); changed.
        cov: Its covariance, shape (4, 4); changed.
        dt_s: Time that passes [s].
        noise: Spectral density of the acceleration [m2/s3].
    """
    mean[0] += dt_s * mean[2]
    mean[1] += dt_s * mean[3]
    # F P F^T: rows, then columns.
    for k in range(4):
        cov[0, k] += dt_s * cov[2, k]
        cov[1, k] += dt_s * cov[3, k]
    for k in range(4):
        cov[k, 0] += dt_s * cov[k, 2]
        cov[k, 1] += dt_s * cov[k, 3]
    for axis in range(2):
        cov[axis, axis] += noise * dt_s * dt_s * dt_s / 3.0
        cov[axis, axis + 2] += noise * dt_s * dt_s / 2.0
        cov[axis + 2, axis] += noise * dt_s * dt_s / 2.0
        cov[axis + 2, axis + 2] += noise * dt_s


@kernel_with_cache
def _update(mean: Float64Array, cov: Float64Array, first: int, zx: float, zy: float, variance: Float64Array) -> float:
    """Fuse a measurement of the two numbers that begin at `first` of the state; its squared Mahalanobis distance."""
    a = cov[first, first] + variance[0, 0]
    b = cov[first, first + 1] + variance[0, 1]
    d = cov[first + 1, first + 1] + variance[1, 1]
    determinant = a * d - b * b
    ia, ib, id_ = d / determinant, -b / determinant, a / determinant
    rx, ry = zx - mean[first], zy - mean[first + 1]
    # A row of the gain at a time; the columns of P that it needs are kept, because P changes.
    c0, c1, c2, c3 = cov[0, first], cov[1, first], cov[2, first], cov[3, first]
    e0, e1, e2, e3 = cov[0, first + 1], cov[1, first + 1], cov[2, first + 1], cov[3, first + 1]
    for k in range(4):
        c = c0 if k == 0 else c1 if k == 1 else c2 if k == 2 else c3
        e = e0 if k == 0 else e1 if k == 1 else e2 if k == 2 else e3
        gx, gy = c * ia + e * ib, c * ib + e * id_
        mean[k] += gx * rx + gy * ry
        cov[k, 0] -= gx * c0 + gy * e0
        cov[k, 1] -= gx * c1 + gy * e1
        cov[k, 2] -= gx * c2 + gy * e2
        cov[k, 3] -= gx * c3 + gy * e3
    distance: float = rx * (ia * rx + ib * ry) + ry * (ib * rx + id_ * ry)
    return distance


@kernel_with_cache
def update(mean: Float64Array, cov: Float64Array, measured: Float64Array, variance: Float64Array) -> float:
    """Fuse a measured place.

    Args:
        mean: x, y [m], vx, vy [m/s], shape (4,); changed.
        cov: Its covariance, shape (4, 4); changed.
        measured: x, y [m], shape (2,).
        variance: Covariance of the measurement [m2], shape (2, 2).

    Returns:
        Squared Mahalanobis distance of the measurement, before it was fused.
    """
    distance: float = _update(mean, cov, 0, measured[0], measured[1], variance)
    return distance


@kernel_with_cache
def update_velocity(mean: Float64Array, cov: Float64Array, measured: Float64Array, variance: Float64Array) -> float:
    """Fuse a measured velocity [m/s] with its covariance [m2/s2]; see `update`."""
    distance: float = _update(mean, cov, 2, measured[0], measured[1], variance)
    return distance
