"""Points in space from where several posed cameras see them."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array

_ITERATIONS = 10
_HUBER_PX = 1.0
"""Sightings that are farther off count less [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangulated:
    """A point with how well it is known."""

    point: Float64Array
    """Position in the cameras' world, shape (3,)."""
    covariance: Float64Array
    """Covariance of the position for an error of 1 px in each sighting, shape (3, 3)."""
    residuals_px: Float64Array
    """Distance between where it was seen and where it should be, shape (V,)."""


def intersect_rays(xy: Float64Array, T_world_camera: Float64Array) -> Float64Array:
    """The point nearest to all rays, in least squares.

    Args:
        xy: Where each camera sees the point, without distortion, at depth 1, shape (V, 2).
        T_world_camera: Poses, shape (V, 4, 4).

    Returns:
        Shape (3,).

    Raises:
        ValueError: If the rays are parallel.
    """
    directions = np.einsum("vij,vj->vi", T_world_camera[:, :3, :3], np.column_stack([xy, np.ones(len(xy))]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    away = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    normal = away.sum(axis=0)
    if np.linalg.eigvalsh(normal)[0] < 1e-10 * len(xy):
        raise ValueError("the rays are parallel: the point was seen from one direction only.")
    centres = T_world_camera[:, :3, 3]
    point: Float64Array = np.linalg.solve(normal, np.einsum("vij,vj->i", away, centres))
    return point


def triangulate(xy: Float64Array, T_world_camera: Float64Array, focal_px: Float64Array) -> Triangulated:
    """The point with the least robust error in the images, beginning where the rays nearly meet.

    Lens distortion is taken out before: `xy` are rays, and an error of `xy` times the focal length is one in pixels.

    Args:
        xy: Where each camera sees the point, without distortion, at depth 1, shape (V, 2), V >= 2.
        T_world_camera: Poses, shape (V, 4, 4).
        focal_px: Focal length of each camera [px], shape (V,).

    Raises:
        ValueError: If the rays are parallel.

    Source: Hartley & Zisserman, 2nd ed., section 12.3 (Gauss-Newton on the reprojection error), weights of Huber.
    """
    point = intersect_rays(xy, T_world_camera)
    R_camera_world = np.swapaxes(T_world_camera[:, :3, :3], 1, 2)
    centres = T_world_camera[:, :3, 3]
    for _ in range(_ITERATIONS):
        error_px, jacobian = _errors(point, xy, R_camera_world, centres, focal_px)
        distance_px = np.linalg.norm(error_px, axis=1)
        weight = np.minimum(1.0, _HUBER_PX / np.maximum(distance_px, 1e-12))
        normal = np.einsum("v,vki,vkj->ij", weight, jacobian, jacobian)
        step = np.linalg.solve(normal, -np.einsum("v,vki,vk->i", weight, jacobian, error_px))
        point = point + step
        if np.linalg.norm(step) <= 1e-12 * np.linalg.norm(point - centres.mean(axis=0)):
            break
    error_px, _ = _errors(point, xy, R_camera_world, centres, focal_px)
    return Triangulated(point=point, covariance=np.linalg.inv(normal), residuals_px=np.linalg.norm(error_px, axis=1))


def _errors(
    point: Float64Array, xy: Float64Array, R_camera_world: Float64Array, centres: Float64Array, focal_px: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Errors in the images, shape (V, 2), and how they change with the point, shape (V, 2, 3)."""
    seen = np.einsum("vij,vj->vi", R_camera_world, point - centres)
    x, y, z = seen.T
    error_px = focal_px[:, None] * (seen[:, :2] / z[:, None] - xy)
    by_seen = np.zeros((len(xy), 2, 3))
    by_seen[:, 0, 0] = by_seen[:, 1, 1] = 1.0 / z
    by_seen[:, 0, 2], by_seen[:, 1, 2] = -x / z**2, -y / z**2
    return error_px, focal_px[:, None, None] * (by_seen @ R_camera_world)
