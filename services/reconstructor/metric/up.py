"""Which way is up in a map, and where its floor is."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import Similarity

FLOOR_MARKER_MAX_DEG = 20.0
"""A marker that leans more against how the cameras were held does not lie on the floor."""
_FLOOR_LEAN_MAX_DEG = 20.0
_PLANES = 400
_THICKNESS = 0.01
"""Half thickness of a floor, as share of the cameras' height above what they see."""
_BELOW_MAX = 0.03
"""A floor has at most this share of all points below it."""
_FLOOR_POINTS_MIN = 50
_SECTORS, _CIRCLE_95 = 8, 1.73
"""The floor's uncertainty is told by leaving out one sector of its points after the other; so many times the root of
the sum of both tilts' variances hold 95 % of all directions: sqrt(-ln 0.05)."""
LEAN_MIN_DEG = 0.5
"""Directions that differ by less are taken for the same: so much is an error of any marker that lies on a floor."""
HELD_ERROR_DEG = 3.0
"""How cameras were held tells up within about this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Floor:
    """The plane that the place stands on, in units of the map."""

    up: Float64Array
    """Unit vector, shape (3,)."""
    point: Float64Array
    """A point on the floor, shape (3,)."""
    source: str
    """What determined the floor, in words."""
    point_count: int = 0
    """Points of the map that lie in it."""
    error_deg: float = 0.0
    """The angle to the true direction is smaller than this in 95 % of cases, as far as the points tell [deg]."""


def held_up(T_world_camera: Float64Array) -> Float64Array:
    """Where up is if cameras were held level, turned about the vertical and nodded, but hardly rolled.

    Args:
        T_world_camera: Shape (V, 4, 4).

    Returns:
        Unit vector, shape (3,).
    """
    right, down = T_world_camera[:, :3, 0], T_world_camera[:, :3, 1]
    mean_up = -down.mean(axis=0)
    values, vectors = np.linalg.eigh(right.T @ right)
    up = vectors[:, 0]
    # Cameras that all looked one way tell nothing about the nod: then their own up has to do.
    if values[1] < 0.05 * values[2]:
        up = mean_up
    up = up if up @ mean_up >= 0 else -up
    return np.asarray(up / np.linalg.norm(up))


def floor_of_points(images: PosedImages, up: Float64Array) -> Floor | None:
    """The plane below the cameras that most points lie in and hardly any below, nearly across `up`.

    Args:
        images: The map.
        up: Where up is, roughly; shape (3,).

    Returns:
        None if there is none, as where no texture is on the floor.
    """
    centres = images.T_world_camera[:, :3, 3]
    heights = images.points @ up
    low, high = np.percentile(heights, 1.0) if len(heights) else 0.0, float(np.median(centres @ up))
    points = images.points[heights < high]
    if len(points) < _FLOOR_POINTS_MIN or high <= low:
        return None
    tolerance = _THICKNESS * (high - low)
    best = _best_plane(points, up, tolerance)
    if best is None:
        return None
    normal, offset = best
    for _ in range(3):
        inliers = points[np.abs(points @ normal - offset) < tolerance]
        normal, offset = _fit_plane(inliers, up)
    inliers = points[np.abs(points @ normal - offset) < tolerance]
    if len(inliers) < _FLOOR_POINTS_MIN:
        return None
    return Floor(
        up=normal,
        point=inliers.mean(axis=0),
        source="floor plane of the points",
        point_count=len(inliers),
        error_deg=_normal_error_deg(inliers, normal),
    )


def _best_plane(points: Float64Array, up: Float64Array, tolerance: float) -> tuple[Float64Array, float] | None:
    """Normal and offset of the plane through three points with the most others in it."""
    rng = np.random.default_rng(0)
    best, best_count = None, 0
    for _ in range(_PLANES):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12:
            continue
        normal = normal * np.sign(normal @ up) / length
        if normal @ up < np.cos(np.radians(_FLOOR_LEAN_MAX_DEG)):
            continue
        above = points @ normal - a @ normal
        count = int((np.abs(above) < tolerance).sum())
        if count > best_count and float((above < -3.0 * tolerance).mean()) <= _BELOW_MAX:
            best, best_count = (normal, float(a @ normal)), count
    return best


def _fit_plane(points: Float64Array, up: Float64Array) -> tuple[Float64Array, float]:
    mean = points.mean(axis=0)
    normal = np.linalg.svd(points - mean, full_matrices=False)[2][2]
    normal = normal if normal @ up >= 0 else -normal
    return normal, float(normal @ mean)


def _normal_error_deg(points: Float64Array, normal: Float64Array) -> float:
    """95 % of the angle between a fitted normal and the true one [deg], by a jackknife over sectors around the middle.

    Points of one sector err together, as a bent map does; single points would promise too much.
    """
    away = points - points.mean(axis=0)
    axes = np.linalg.svd(away, full_matrices=False)[2][:2]
    order = np.argsort(np.arctan2(away @ axes[1], away @ axes[0]))
    sectors = np.array_split(order, _SECTORS)
    normals = [_fit_plane(np.delete(points, sector, axis=0), normal)[0] for sector in sectors]
    off = np.array(normals) - np.mean(normals, axis=0)
    variance = (_SECTORS - 1) / _SECTORS * float((off**2).sum())
    return float(np.degrees(_CIRCLE_95 * np.sqrt(variance)))


def lean_deg(up: Float64Array, other: Float64Array) -> float:
    """Angle between two directions [deg]."""
    return float(np.degrees(np.arccos(np.clip(up @ other, -1.0, 1.0))))


def world_from_map(floor: Floor, forward: Float64Array, origin: Float64Array, metres_per_unit: float) -> Similarity:
    """The similarity that makes a map metric, z up, with z = 0 on the floor.

    Args:
        floor: In the map.
        forward: What becomes x, as far as it is level; shape (3,).
        origin: What x = y = 0 is above or below; shape (3,).
        metres_per_unit: Scale of the map.
    """
    z = floor.up / np.linalg.norm(floor.up)
    x = forward - (forward @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    foot = origin - ((origin - floor.point) @ z) * z
    return Similarity(scale=metres_per_unit, R=R, t=-metres_per_unit * R @ foot)
