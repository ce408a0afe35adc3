"""Similarity transforms between two sets of corresponding points: scale, rotation and translation."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """Maps points of frame `a` to frame `b`: p_b = scale R p_a + t."""

    scale: float
    R: Float64Array
    """Rotation, shape (3, 3)."""
    t: Float64Array
    """Translation, shape (3,), in units of frame b."""

    def apply(self, points: npt.ArrayLike) -> Float64Array:
        """Points of frame a, shape (..., 3), in frame b."""
        return self.scale * np.asarray(points, dtype=np.float64) @ self.R.T + self.t

    def moved_poses(self, T_a_camera: Float64Array) -> Float64Array:
        """Camera poses in frame a, shape (..., 4, 4), as poses in frame b."""
        T_b_camera = np.array(T_a_camera, dtype=np.float64)
        T_b_camera[..., :3, :3] = self.R @ T_b_camera[..., :3, :3]
        T_b_camera[..., :3, 3] = self.apply(T_b_camera[..., :3, 3])
        return T_b_camera


def umeyama(source: npt.ArrayLike, target: npt.ArrayLike) -> Similarity:
    """The similarity that maps source points to target points with the least squared error.

    Points may lie in a plane, as the corners of a marker do, but not on a line.

    Args:
        source: Points in frame a, shape (N, 3), at least 3.
        target: The same points in frame b, shape (N, 3).

    Raises:
        ValueError: If shapes differ, or the points lie on a line.

    Source: Umeyama, Least-squares estimation of transformation parameters between two point patterns, PAMI 1991.
    """
    a, b = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3 or len(a) < 3:
        raise ValueError(f"source and target must have the same shape (N, 3), N >= 3, got {a.shape} and {b.shape}.")
    w = np.full(len(a), 1.0 / len(a))
    mean_a, mean_b = w @ a, w @ b
    da, db = a - mean_a, b - mean_b
    U, D, Vt = np.linalg.svd((w[:, None] * db).T @ da)
    if D[1] <= 1e-12 * D[0] or D[0] == 0.0:
        raise ValueError("the points lie on a line or in one place: no rotation follows from them.")
    S = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    R = U @ np.diag(S) @ Vt
    scale = float((D * S).sum() / (w @ (da**2).sum(axis=1)))
    return Similarity(scale=scale, R=R, t=mean_b - scale * R @ mean_a)
