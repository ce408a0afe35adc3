"""Rotations between two rotations."""

import math

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.kernels import kernel_with_cache


@kernel_with_cache(error_model="numpy")
def turn_between(first: Float32Array, last: Float32Array, share: float, out: Float32Array) -> None:
    """Interpolate rotations along the shorter way (slerp).

    Args:
        first: Axis-angle vectors [rad] where `share` is 0, shape (J, 3).
        last: Axis-angle vectors [rad] where `share` is 1, shape (J, 3).
        share: Share of the turn that is done, 0..1.
        out: Filled with axis-angle vectors.
    """
    p, q, r = np.empty(4), np.empty(4), np.empty(4)
    for j in range(len(first)):
        _quaternion(first[j], p)
        _quaternion(last[j], q)
        dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
        sign = -1.0 if dot < 0.0 else 1.0
        dot = min(dot * sign, 1.0)
        angle = math.acos(dot)
        if angle < 1e-6:
            a, b = 1.0 - share, share * sign
        else:
            a, b = math.sin((1.0 - share) * angle) / math.sin(angle), sign * math.sin(share * angle) / math.sin(angle)
        for k in range(4):
            r[k] = a * p[k] + b * q[k]
        length = math.sqrt(r[1] * r[1] + r[2] * r[2] + r[3] * r[3])
        if r[0] < 0.0:
            length, r[0] = -length, -r[0]
        scale = 2.0 * math.atan2(abs(length), r[0]) / length if abs(length) > 1e-12 else 2.0
        for k in range(3):
            out[j, k] = scale * r[k + 1]


@kernel_with_cache(error_model="numpy")
def _quaternion(rotation: Float32Array, q: Float64Array) -> None:
    """Write the unit quaternion, w first, of an axis-angle vector."""
    x, y, z = float(rotation[0]), float(rotation[1]), float(rotation[2])
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    q[0], q[1], q[2], q[3] = math.cos(0.5 * angle), scale * x, scale * y, scale * z
