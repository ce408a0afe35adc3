"""A map of cameras and points as arrays: what the mapper makes, and all that comes after it reads."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array, UInt8Array
from readygo.services.reconstructor.similarity import Similarity


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedImages:
    """Images with poses, and the points that they share; units are the mapper's own until the map is metric.

    Images are in the order of `image_order` of their names, which is that of time in a video.
    """

    names: tuple[str, ...]
    T_world_camera: Float64Array
    """Poses of the cameras, shape (V, 4, 4)."""
    focal_px: Float64Array
    """Mean of fx and fy, shape (V,) [px]."""
    size_px: Int64Array
    """Width and height, shape (V, 2)."""
    rays: Callable[[int, Float64Array], Float64Array]
    """Gives, by an image's number and pixels of shape (N, 2), pixel centres at +0.5, their rays at depth 1, shape (N,
    2)."""
    points: Float64Array
    """Points of the map, shape (P, 3)."""
    points_rgb: UInt8Array
    """Colours of the points, shape (P, 3)."""
    seen: Int64Array
    """Sightings of points: rows of the numbers of image and point, shape (M, 2)."""
    errors_px: Float64Array
    """Mean reprojection error of each point, shape (P,) [px]."""

    def only(self, names: Collection[str]) -> "PosedImages":
        """The same map without its other images; its points stay."""
        rows = np.array([row for row, name in enumerate(self.names) if name in names], dtype=np.int64)
        number = np.full(len(self.names), -1)
        number[rows] = np.arange(len(rows))
        seen = np.column_stack([number[self.seen[:, 0]], self.seen[:, 1]])
        return replace(
            self,
            names=tuple(self.names[row] for row in rows),
            T_world_camera=self.T_world_camera[rows],
            focal_px=self.focal_px[rows],
            size_px=self.size_px[rows],
            rays=lambda view, pixels: self.rays(int(rows[view]), pixels),
            seen=seen[seen[:, 0] >= 0],
        )

    def transform(self, b_from_a: Similarity) -> "PosedImages":
        """The same map in another frame, possibly of another scale."""
        T, points = b_from_a.moved_poses(self.T_world_camera), b_from_a.apply(self.points)
        return replace(self, T_world_camera=T, points=points)
