"""Scalar rotation and signal functions of the gait, compiled.

Rotations act on SMPL's y-up axes: x left, y up, z forward. Everything here is scalar code in a fixed order, so that
results do not depend on the width of the machine's vector unit.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.kernels import kernel_with_cache


@kernel_with_cache
def rot_x(angle_rad: float) -> Float64Array:
    """Rotation about x: a positive angle pitches the forward axis down."""
    R = np.eye(3)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    R[1, 1], R[1, 2], R[2, 1], R[2, 2] = c, -s, s, c
    return R


@kernel_with_cache
def rot_y(angle_rad: float) -> Float64Array:
    """Rotation about y: a positive angle turns left."""
    R = np.eye(3)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    R[0, 0], R[0, 2], R[2, 0], R[2, 2] = c, s, -s, c
    return R


@kernel_with_cache
def rot_z(angle_rad: float) -> Float64Array:
    """Rotation about z: a positive angle raises the left side."""
    R = np.eye(3)
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    R[0, 0], R[0, 1], R[1, 0], R[1, 1] = c, -s, s, c
    return R


@kernel_with_cache
def mat_mul(A: Float64Array, B: Float64Array) -> Float64Array:
    """Product of two 3x3 matrices."""
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@kernel_with_cache
def mat_t_mul(A: Float64Array, B: Float64Array) -> Float64Array:
    """Product of the transpose of A with B."""
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]
    return C


@kernel_with_cache
def mat_vec(A: Float64Array, v: Float64Array) -> Float64Array:
    """Product of a 3x3 matrix with a vector."""
    w = np.empty(3)
    for i in range(3):
        w[i] = A[i, 0] * v[0] + A[i, 1] * v[1] + A[i, 2] * v[2]
    return w


@kernel_with_cache
def norm(v: Float64Array) -> float:
    """Length of a 3-vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel_with_cache
def frame_of(y_axis: Float64Array, z_hint: Float64Array) -> Float64Array:
    """Rotation whose y axis is along `y_axis` and whose z axis lies closest to `z_hint`."""
    F = np.empty((3, 3))
    length = norm(y_axis)
    y0, y1, y2 = y_axis[0] / length, y_axis[1] / length, y_axis[2] / length
    along = z_hint[0] * y0 + z_hint[1] * y1 + z_hint[2] * y2
    z0, z1, z2 = z_hint[0] - along * y0, z_hint[1] - along * y1, z_hint[2] - along * y2
    length = math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
    z0, z1, z2 = z0 / length, z1 / length, z2 / length
    F[0, 0], F[1, 0], F[2, 0] = y1 * z2 - y2 * z1, y2 * z0 - y0 * z2, y0 * z1 - y1 * z0
    F[0, 1], F[1, 1], F[2, 1] = y0, y1, y2
    F[0, 2], F[1, 2], F[2, 2] = z0, z1, z2
    return F


@kernel_with_cache
def axis_angle_of(R: Float64Array, out: Float64Array) -> None:
    """Write the axis-angle vector [rad] of a rotation matrix to `out`; the angle is within 0..pi."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    q = np.empty(4)
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        q[0], q[1], q[2], q[3] = 0.25 * s, (R[2, 1] - R[1, 2]) / s, (R[0, 2] - R[2, 0]) / s, (R[1, 0] - R[0, 1]) / s
    else:
        i = 0
        if R[1, 1] > R[0, 0]:
            i = 1
        if R[2, 2] > R[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2.0 * math.sqrt(max(1.0 + R[i, i] - R[j, j] - R[k, k], 1e-30))
        q[0] = (R[k, j] - R[j, k]) / s
        q[1 + i], q[1 + j], q[1 + k] = 0.25 * s, (R[j, i] + R[i, j]) / s, (R[k, i] + R[i, k]) / s
    sign = -1.0 if q[0] < 0.0 else 1.0
    length = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if length < 1e-12 else 2.0 * sign * math.atan2(length, sign * q[0]) / length
    out[0], out[1], out[2] = scale * q[1], scale * q[2], scale * q[3]


@kernel_with_cache
def ease(x: float) -> float:
    """Quintic step from 0 to 1 with flat ends; constant outside of 0..1."""
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (x * (6.0 * x - 15.0) + 10.0)


@kernel_with_cache
def clip(x: float, low: float, high: float) -> float:
    """`x` held within low..high."""
    return min(max(x, low), high)


@kernel_with_cache
def wrap(angle_rad: float) -> float:
    """Angle within -pi..pi."""
    return angle_rad - 2.0 * math.pi * math.floor(angle_rad / (2.0 * math.pi) + 0.5)


@kernel_with_cache
def smooth(x: Float64Array, sigma: float) -> Float64Array:
    """Gaussian filter over samples, ends held; `sigma` in samples."""
    radius = math.ceil(3.0 * sigma)
    count = len(x)
    kernel = np.empty(2 * radius + 1)
    total = 0.0
    for k in range(2 * radius + 1):
        kernel[k] = math.exp(-0.5 * ((k - radius) / sigma) ** 2)
        total += kernel[k]
    y = np.empty(count)
    for i in range(count):
        acc = 0.0
        for k in range(2 * radius + 1):
            acc += kernel[k] * x[min(max(i + k - radius, 0), count - 1)]
        y[i] = acc / total
    return y


@kernel_with_cache
def smooth_above(x: Float64Array, sigma: float) -> Float64Array:
    """A smooth curve that is nowhere below `x` (maximum filter, then Gaussian of the same radius)."""
    radius = math.ceil(3.0 * sigma)
    count = len(x)
    top = np.empty(count)
    for i in range(count):
        best = x[i]
        for k in range(max(i - radius, 0), min(i + radius, count - 1) + 1):
            best = max(best, x[k])
        top[i] = best
    return smooth(top, sigma)


@kernel_with_cache
def sample(x: Float64Array, at: float) -> float:
    """Linear interpolation of a series at a fractional index, ends held."""
    last = len(x) - 1
    at = min(max(at, 0.0), float(last))
    i = min(int(at), max(last - 1, 0))
    j = min(i + 1, last)
    value: float = x[i] + (at - i) * (x[j] - x[i])
    return value


@kernel_with_cache
def soft_max(a: float, b: float, softness: float) -> float:
    """The larger of two values, rounded where they are within some `softness` of each other."""
    top = max(a, b)
    if softness <= 1e-6:
        return top
    return top + softness * math.log(math.exp((a - top) / softness) + math.exp((b - top) / softness))


class Ground(NamedTuple):
    """A floor map as compiled code takes it."""

    height_m: Float32Array
    """World z of the floor at cell centres [m], shape (H, W)."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float


@kernel_with_cache
def floor_at(ground: Ground, x: float, z: float) -> float:
    """Floor height [m] at a point (x, z) of the y-up world, as `FloorMap.at` of (x, -z)."""
    height_m = ground.height_m
    rows, columns = height_m.shape
    u = clip((x - ground.origin_x_m) / ground.resolution_m - 0.5, 0.0, columns - 1.0)
    v = clip((-z - ground.origin_y_m) / ground.resolution_m - 0.5, 0.0, rows - 1.0)
    j, i = min(int(u), max(columns - 2, 0)), min(int(v), max(rows - 2, 0))
    j1, i1 = min(j + 1, columns - 1), min(i + 1, rows - 1)
    a, b = u - j, v - i
    low = (1.0 - a) * height_m[i, j] + a * height_m[i, j1]
    high = (1.0 - a) * height_m[i1, j] + a * height_m[i1, j1]
    height: float = (1.0 - b) * low + b * high
    return height
