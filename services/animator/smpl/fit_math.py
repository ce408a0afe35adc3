"""Rotations from points, compiled: alignment of point sets, shortest ways, twists. Scalar code in a fixed order."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.services.animator.gait.math import frame_of, mat_mul, mat_vec, norm

SMALL = 1e-9
JACOBI_SWEEPS = 8


@kernel_with_cache
def _largest_eigenvector(K: Float64Array) -> Float64Array:
    """Eigenvector of the largest eigenvalue of a symmetric 4x4 matrix, by Jacobi rotations; `K` is overwritten."""
    V = np.eye(4)
    for _ in range(JACOBI_SWEEPS):
        for p in range(3):
            for q in range(p + 1, 4):
                if abs(K[p, q]) < 1e-300:
                    continue
                theta = (K[q, q] - K[p, p]) / (2.0 * K[p, q])
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(4):
                    a, b = K[k, p], K[k, q]
                    K[k, p], K[k, q] = c * a - s * b, s * a + c * b
                for k in range(4):
                    a, b = K[p, k], K[q, k]
                    K[p, k], K[q, k] = c * a - s * b, s * a + c * b
                    a, b = V[k, p], V[k, q]
                    V[k, p], V[k, q] = c * a - s * b, s * a + c * b
    best = 0
    for k in range(1, 4):
        if K[k, k] > K[best, best]:
            best = k
    return V[:, best].copy()


@kernel_with_cache
def align(source: Float64Array, target: Float64Array, weight: Float64Array) -> Float64Array:
    """Rotation R that minimises sum_i w_i |R source_i - target_i|^2, shape (3, 3).

    Three points that lie in one plane with the origin are enough; noise does not make a mirror image of it.

    Args:
        source: Vectors, shape (N, 3).
        target: Vectors, shape (N, 3).
        weight: Shape (N,).

    Source: Horn, Closed-form solution of absolute orientation using unit quaternions, 1987.
    """
    S = np.zeros((3, 3))
    for n in range(len(source)):
        for i in range(3):
            for j in range(3):
                S[i, j] += weight[n] * source[n, i] * target[n, j]
    K = np.empty((4, 4))
    K[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
    K[1, 1] = S[0, 0] - S[1, 1] - S[2, 2]
    K[2, 2] = S[1, 1] - S[0, 0] - S[2, 2]
    K[3, 3] = S[2, 2] - S[0, 0] - S[1, 1]
    K[0, 1] = K[1, 0] = S[1, 2] - S[2, 1]
    K[0, 2] = K[2, 0] = S[2, 0] - S[0, 2]
    K[0, 3] = K[3, 0] = S[0, 1] - S[1, 0]
    K[1, 2] = K[2, 1] = S[0, 1] + S[1, 0]
    K[1, 3] = K[3, 1] = S[2, 0] + S[0, 2]
    K[2, 3] = K[3, 2] = S[1, 2] + S[2, 1]
    w, x, y, z = _largest_eigenvector(K)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return R


@kernel_with_cache
def cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Cross product of two 3-vectors."""
    c = np.empty(3)
    c[0], c[1], c[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return c


@kernel_with_cache
def dot(a: Float64Array, b: Float64Array) -> float:
    """Dot product of two 3-vectors."""
    value: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return value


@kernel_with_cache
def unit(v: Float64Array, fallback: Float64Array) -> Float64Array:
    """`v` at length 1, or `fallback` where `v` has no length."""
    length = norm(v)
    return v / length if length > SMALL else fallback.copy()


@kernel_with_cache
def turn(axis: Float64Array, angle_rad: float) -> Float64Array:
    """Rotation about a unit axis (Rodrigues)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = (1.0 - c) * axis[i] * axis[j]
        R[i, i] += c
    R[0, 1] -= s * axis[2]
    R[1, 0] += s * axis[2]
    R[0, 2] += s * axis[1]
    R[2, 0] -= s * axis[1]
    R[1, 2] -= s * axis[0]
    R[2, 1] += s * axis[0]
    return R


@kernel_with_cache
def swing(G: Float64Array, bone: Float64Array, direction: Float64Array) -> Float64Array:
    """`G` turned by the shortest way so that its bone points along a unit direction.

    Args:
        G: Rotation, shape (3, 3).
        bone: Vector in the frame of G, shape (3,); without length, G is returned.
        direction: Unit vector, shape (3,). Opposite to the bone, the turn is about an axis across the bone.
    """
    now = mat_vec(G, bone)
    length = norm(now)
    if length < SMALL:
        return G.copy()
    now = now / length
    axis = cross(now, direction)
    sine, cosine = norm(axis), dot(now, direction)
    if sine < SMALL:
        if cosine > 0.0:
            return G.copy()
        least = np.zeros(3)
        least[np.argmin(np.abs(now))] = 1.0
        axis = cross(now, least)
        return mat_mul(turn(axis / norm(axis), math.pi), G)
    return mat_mul(turn(axis / sine, math.atan2(sine, cosine)), G)


@kernel_with_cache
def aim(bone: Float64Array, hinge: Float64Array, direction: Float64Array, normal: Float64Array) -> Float64Array:
    """Rotation that takes a bone to a direction, and the hinge as close as possible to a normal of the bend plane."""
    F, H = frame_of(bone, hinge), frame_of(direction, normal)
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = H[i, 0] * F[j, 0] + H[i, 1] * F[j, 1] + H[i, 2] * F[j, 2]
    return R


@kernel_with_cache
def across(v: Float64Array, axis: Float64Array) -> Float64Array:
    """The part of `v` perpendicular to a unit axis."""
    return v - dot(v, axis) * axis


@kernel_with_cache
def twist_about(R: Float64Array, axis: Float64Array) -> float:
    """Angle [rad] of the twist of a rotation about a unit axis (swing-twist decomposition), within -pi..pi."""
    # The vector and scalar parts of the quaternion, times 4 w; w = 0 is a half turn.
    w4 = 1.0 + R[0, 0] + R[1, 1] + R[2, 2]
    along = (R[2, 1] - R[1, 2]) * axis[0] + (R[0, 2] - R[2, 0]) * axis[1] + (R[1, 0] - R[0, 1]) * axis[2]
    return 2.0 * math.atan2(along, max(w4, 1e-12))
