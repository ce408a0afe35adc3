"""Where Gaussians begin on what a device has measured: its depth images as points, also of bare floors and walls."""

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.services.reconstructor.training.between import agreed_means
from readygo.services.reconstructor.training.photos import Photo, PhotoStore, Posed

_SIDE_PX = 256
"""Longer side of the images whose pixels become points: depth images of phones have no more."""
_CELL = 0.04
"""Side of the cells, in median depths: in smaller ones, points of one surface lie in several layers, as depths of
phones are off by 1 % and more."""


def points_of_depths(posed: Posed, numbers: tuple[int, ...], count_max: int) -> tuple[Float64Array, UInt8Array]:
    """Places on which the depth images of two or more moments agree, one in each cell.

    Args:
        posed: The map, with depth images.
        numbers: Of the views that are looked at.
        count_max: Of more places some are taken, evenly.

    Returns:
        Points [m], shape (n, 3); their colours, shape (n, 3).
    """
    photos = PhotoStore(posed, numbers, _SIDE_PX, 1)
    depths = (photos.depth_m(number) for number in numbers)
    medians_m = [float(np.median(depth_m[depth_m > 0])) for depth_m in depths if depth_m is not None and depth_m.any()]
    if not medians_m:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.uint8)
    cell_m = _CELL * float(np.median(medians_m))
    # One image at a time: all pixels of hundreds would fill the memory.
    parts = [_of_photo(photos[number], cell_m) for number in numbers]
    moment = np.repeat(posed.moments[list(numbers)], [len(part) for part in parts])
    found = agreed_means(np.concatenate(parts), moment, cell_m)
    found = found[:: len(found) // count_max + 1]
    return found[:, :3], np.rint(255.0 * found[:, 3:]).astype(np.uint8)


def _of_photo(photo: Photo, cell_m: float) -> Float64Array:
    """Mean places and colours of the measured pixels of a photo in each cell, shape (n, 6)."""
    if photo.depth_m is None:
        return np.empty((0, 6))
    v, u = np.nonzero(photo.depth_m if photo.mask is None else photo.depth_m * photo.mask)
    rays = np.column_stack([u + 0.5, v + 0.5, np.ones(len(u))]) @ np.linalg.inv(photo.K_px).T
    T = photo.T_world_camera
    places_m = (rays * photo.depth_m[v, u, None]) @ T[:3, :3].T + T[:3, 3]
    found = np.column_stack([places_m, photo.rgb[:, v, u].T])
    return agreed_means(found, np.zeros(len(found), dtype=np.int64), cell_m, images_min=1)
