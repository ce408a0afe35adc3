"""Lengths of lines of sight in a scene, on its map."""

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.maps import GridFrame


def sight_m(
    opaque: BoolArray, frame: GridFrame, xy_m: Float64Array, bearings_rad: Float64Array, *, far_m: float = 4.0
) -> Float64Array:
    """Length of the line of sight from places along bearings [m].

    Args:
        opaque: True for cells that block the view, shape (H, W).
        frame: Grid of the cells.
        xy_m: Places [m], shape (N, 2).
        bearings_rad: Directions [rad], shape (B,).
        far_m: Largest length [m].

    Returns:
        Lengths [m], shape (N, B).
    """
    steps_m = np.arange(0.1, far_m, frame.resolution_m)
    way = np.stack([np.cos(bearings_rad), np.sin(bearings_rad)], axis=1)[:, None] * steps_m[:, None]
    corner = np.array([frame.origin_x_m, frame.origin_y_m])
    rows, columns = opaque.shape
    out = np.empty((len(xy_m), len(bearings_rad)))
    for number, place in enumerate(xy_m):
        cell = np.floor((place + way - corner) / frame.resolution_m).astype(np.int64)
        j, i = np.clip(cell[..., 0], 0, columns - 1), np.clip(cell[..., 1], 0, rows - 1)
        hit = opaque[i, j]
        out[number] = np.where(hit.any(axis=1), steps_m[np.argmax(hit, axis=1)], far_m)
    return out
