"""Rotations between frames: quaternions, axis-angle vectors and matrices.

Quaternions are (w, x, y, z). Batches are leading dimensions.
"""

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array


def matrix_from_quat(q_wxyz: npt.ArrayLike) -> Float64Array:
    """Rotation matrices of quaternions that need not be normalised.

    Args:
        q_wxyz: Quaternions, shape (..., 4).

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    q = np.asarray(q_wxyz, dtype=np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quat_from_matrix(R: npt.ArrayLike) -> Float64Array:
    """Quaternions (w >= 0) of rotation matrices.

    Args:
        R: Rotation matrices, shape (..., 3, 3).

    Returns:
        Quaternions, shape (..., 4).

    Source: Shepperd, Quaternion from rotation matrix, 1978.
    """
    R = np.asarray(R, dtype=np.float64)
    d0, d1, d2 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    squares = np.stack([1 + d0 + d1 + d2, 1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2], axis=-1)
    a, b, c = R[..., 2, 1], R[..., 0, 2], R[..., 1, 0]
    at, bt, ct = R[..., 1, 2], R[..., 2, 0], R[..., 0, 1]
    candidates = np.stack(
        [
            np.stack([squares[..., 0], a - at, b - bt, c - ct], axis=-1),
            np.stack([a - at, squares[..., 1], c + ct, b + bt], axis=-1),
            np.stack([b - bt, c + ct, squares[..., 2], a + at], axis=-1),
            np.stack([c - ct, b + bt, a + at, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)[..., None, None]
    q = np.take_along_axis(candidates, best, axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    result: Float64Array = np.where(q[..., :1] < 0, -q, q)
    return result


def quat_multiply(p_wxyz: npt.ArrayLike, q_wxyz: npt.ArrayLike) -> Float64Array:
    """Hamilton product: the rotation `q` followed by `p`, shapes (..., 4)."""
    p, q = np.asarray(p_wxyz, dtype=np.float64), np.asarray(q_wxyz, dtype=np.float64)
    pw, px, py, pz = np.moveaxis(p, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def matrix_from_axis_angle(axis_angle_rad: npt.ArrayLike) -> Float64Array:
    """Rotation matrices of axis-angle vectors [rad], shape (..., 3) -> (..., 3, 3) (Rodrigues)."""
    v = np.asarray(axis_angle_rad, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    K = np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)],
        axis=-2,
    )
    # sinc keeps both factors smooth through angle = 0.
    s = np.sinc(angle / np.pi)
    c = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    R: Float64Array = np.eye(3) + s * K + c * (K @ K)
    return R


def axis_angle_from_matrix(R: npt.ArrayLike) -> Float64Array:
    """Axis-angle vectors [rad] of rotation matrices, shape (..., 3, 3) -> (..., 3), angle in [0, pi]."""
    q = quat_from_matrix(R)
    w, v = q[..., :1], q[..., 1:]
    n = np.linalg.norm(v, axis=-1, keepdims=True)
    small = n < 1e-12
    scale: Float64Array = np.where(small, 2.0, 2 * np.arctan2(n, w) / np.where(small, 1.0, n))
    axis_angle: Float64Array = scale * v
    return axis_angle


def wrap_angle(angle_rad: npt.ArrayLike) -> Float64Array:
    """Angles [rad] wrapped to [-pi, pi)."""
    wrapped: Float64Array = (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
    return wrapped
