"""Where Gaussians begin between the map's points: bare floors and walls have hardly any.

What an image shows between three neighbouring points of the map is taken for the plane through them, over which the
inverse of the depth changes linearly in the image; towards the image's border, for the plane that fits the nearest
points best. Where images agree on a place, it is one to begin at.
"""

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from readygo.common.arrays import Float64Array, Int64Array, UInt8Array
from readygo.services.reconstructor.training.photos import Photo, PhotoStore, Posed

SIDE_PX = 64
"""Each pixel of images so small (longer side) is a place that is looked at."""
_DEPTHS_MAX = 1.4
"""Largest depth of three points relative to their smallest: others lie on different things."""
_BORDER, _NEAREST = 6, 12
"""Each side of an image has so many points on its border; the nearest points tell their depths."""
_IMAGES_MIN = 2
_CELL = 0.02
"""So many images agree where they have places in one cell, so large in median depths of the map's points."""


def points_between(posed: Posed, numbers: tuple[int, ...], count_max: int) -> tuple[Float64Array, UInt8Array]:
    """Places on which images agree.

    Args:
        posed: The map.
        numbers: Of the views that are looked at.
        count_max: Of more places some are taken, evenly.

    Returns:
        Points [m], shape (n, 3); their colours, shape (n, 3).
    """
    photos = PhotoStore(posed, numbers, SIDE_PX, 1)
    shown = [posed.points_m[posed.seen[posed.seen[:, 0] == number, 1]] for number in numbers]
    parts = [_of_photo(photos[number], points_m) for number, points_m in zip(numbers, shown, strict=True)]
    found, moment = np.concatenate(parts), np.repeat(posed.moments[list(numbers)], [len(part) for part in parts])
    if len(found):
        places_m = posed.views.T_world_camera[list(numbers), :3, 3]
        away_m = [np.linalg.norm(points_m - place_m, axis=1) for points_m, place_m in zip(shown, places_m, strict=True)]
        found = agreed_means(found, moment, _CELL * float(np.median(np.concatenate(away_m))))
    found = found[:: len(found) // count_max + 1]
    return found[:, :3], np.rint(255.0 * found[:, 3:]).astype(np.uint8)


def agreed_means(found: Float64Array, moment: Int64Array, cell_m: float, images_min: int = _IMAGES_MIN) -> Float64Array:
    """Means of what lies in one cell, of the cells in which enough images have something, shape (n, 6).

    Args:
        found: Positions [m] and colours, shape (N, 6).
        moment: Number of the moment at which each was seen, shape (N,): views of one 360-degree image count once.
        cell_m: Side of the cells.
        images_min: So many images are enough.
    """
    cells = np.floor(found[:, :3] / cell_m).astype(np.int64)
    _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    images = np.bincount(np.unique(np.stack([cell, moment]), axis=1)[0])
    means = np.stack([np.bincount(cell, column) / counts for column in found.T], axis=1)
    return np.asarray(means[images >= images_min], dtype=np.float64)


def _of_photo(photo: Photo, points_m: Float64Array) -> Float64Array:
    """Places and colours of the pixels of a photo that lie between points that it shows, shape (n, 6)."""
    T, K = photo.T_world_camera, photo.K_px
    p_C = (points_m - T[:3, 3]) @ T[:3, :3]
    p_C = p_C[p_C[:, 2] > 0]
    height, width = photo.rgb.shape[1:]
    p_px, depths_m = _with_border((p_C @ K.T)[:, :2] / p_C[:, 2:], p_C[:, 2], (width, height))
    try:
        mesh = Delaunay(p_px)
    except (QhullError, ValueError):  # too few points, or all in one line
        return np.empty((0, 6))
    v, u = np.divmod(np.arange(height * width), width)
    pixels = np.stack([u, v], axis=1) + 0.5
    triangle = mesh.find_simplex(pixels)
    depths_m = depths_m[mesh.simplices]
    flat = depths_m.max(axis=1) < _DEPTHS_MAX * depths_m.min(axis=1)
    chosen = (triangle >= 0) & flat[triangle]
    if photo.mask is not None:
        chosen &= photo.mask.ravel()
    u, v, pixels, triangle = u[chosen], v[chosen], pixels[chosen], triangle[chosen]
    affine = mesh.transform[triangle]
    weights = np.einsum("nij,nj->ni", affine[:, :2], pixels - affine[:, 2])
    weights = np.column_stack([weights, 1.0 - weights.sum(axis=1)])
    depth_m = 1.0 / (weights / depths_m[triangle]).sum(axis=1)
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(K).T
    places = (rays * depth_m[:, None]) @ T[:3, :3].T + T[:3, 3]
    return np.column_stack([places, photo.rgb[:, v, u].T])


def _with_border(
    p_px: Float64Array, depths_m: Float64Array, size_px: tuple[int, int]
) -> tuple[Float64Array, Float64Array]:
    """Pixels and depths of points, and of as many on the image's border as the points can tell of."""
    if len(p_px) < _NEAREST:
        return p_px, depths_m
    along, zero = np.linspace(0.0, 1.0, _BORDER, endpoint=False), np.zeros(_BORDER)
    sides = [(along, zero), (zero + 1.0, along), (1.0 - along, zero + 1.0), (zero, 1.0 - along)]
    border_px = np.concatenate([np.column_stack(side) for side in sides]) * size_px
    _, nearest = cKDTree(p_px).query(border_px, k=_NEAREST)
    inverse = 1.0 / depths_m[nearest]
    mean_px, mean = p_px[nearest].mean(axis=1), inverse.mean(axis=1)
    off_px = p_px[nearest] - mean_px[:, None]
    # A little is added so that points in one line tell of no slope across it.
    normal = off_px.swapaxes(1, 2) @ off_px + np.eye(2) * 1e-2 * np.square(off_px).sum(axis=(1, 2))[:, None, None]
    slope = np.linalg.solve(normal, off_px.swapaxes(1, 2) @ (inverse - mean[:, None])[:, :, None])[:, :, 0]
    found = mean + ((border_px - mean_px) * slope).sum(axis=1)
    found = np.clip(found, inverse.min(axis=1) / _DEPTHS_MAX, inverse.max(axis=1) * _DEPTHS_MAX)
    return np.concatenate([p_px, border_px]), np.concatenate([depths_m, 1.0 / found])
