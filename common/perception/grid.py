"""The map over bearing and distance that people are perceived on, and its peaks.

A column of the map is a strip of the image from top to bottom; its bearing is that of its middle behind the lens. A row
is a ring of distances from the camera; rings are equally wide in proportion to their distance.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.camera.lens import make_lens

NEAR_M, FAR_M = 0.35, 10.0
"""Distances from the camera that the rings begin and end at [m]."""
SHAPE = (16, 32)
"""Rings and columns of the map."""
SAME_PERSON_M = 0.5
"""Peaks nearer to each other than this are one human [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PolarGrid:
    """Where the cells of a camera's map lie."""

    bearings_rad: Float64Array
    """Bearing of each column's middle, from the camera's heading to the left [rad], falling, shape (C,)."""
    distances_m: Float64Array
    """Distance of each ring's middle (geometric) from the camera [m], rising, shape (D,)."""

    @property
    def ring_step(self) -> float:
        """Distance of neighbouring rings, as a difference of logarithms."""
        return math.log(FAR_M / NEAR_M) / len(self.distances_m)

    def column_of(self, bearing_rad: Float64Array) -> Int64Array:
        """Columns that bearings fall into, by the nearest middle."""
        falling = self.bearings_rad
        edges = -0.5 * (falling[1:] + falling[:-1])
        columns: Int64Array = np.searchsorted(edges, -np.asarray(bearing_rad))
        return columns


@cache
def polar_grid(camera: CameraConfig) -> PolarGrid:
    """The grid of a camera: the middles of its columns at its own height."""
    rings, columns = SHAPE
    u_px = (np.arange(columns) + 0.5) * camera.width_px / columns
    rays = make_lens(camera).rays(np.stack([u_px, np.full(columns, camera.K_px[1, 2])], axis=1))
    log_m = np.log(NEAR_M) + (np.arange(rings) + 0.5) * math.log(FAR_M / NEAR_M) / rings
    return PolarGrid(bearings_rad=-np.arctan(rays[:, 0]), distances_m=np.exp(log_m))


def peaks(presence: Float64Array, threshold: float) -> Int64Array:
    """Cells that are likelier than their eight neighbours, the likeliest first: ring and column, shape (N, 2).

    Args:
        presence: Probability of each cell, shape (D, C).
        threshold: Less likely ones are left out.
    """
    padded = np.pad(presence, 1, constant_values=-np.inf)
    rings, columns = presence.shape
    around = np.stack([padded[a : a + rings, b : b + columns] for a in range(3) for b in range(3)])
    rows = np.argwhere((presence >= threshold) & (presence >= around.max(axis=0)))
    order = np.argsort(-presence[rows[:, 0], rows[:, 1]], kind="stable")
    found: Int64Array = rows[order]
    return found
