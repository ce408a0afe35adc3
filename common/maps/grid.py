"""2-D grids of a scene: which cells block an agent, and how high the floor is."""

import math
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, FloatingArray, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages.checks import check_array


@dataclass(frozen=True, kw_only=True, eq=False)
class GridFrame:
    """Where a grid lies: cell (row i, column j) covers x = origin_x + j*r .. +(j+1)*r, y = origin_y + i*r .. ."""

    origin_x_m: float
    """World x of the corner of cell (0, 0) with the smallest x and y [m]."""
    origin_y_m: float
    """World y of that corner [m]."""
    resolution_m: float
    """Edge of a cell [m]."""

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Row and column of the cell that holds a point (may lie outside of the grid).

        Args:
            x_m: World x [m].
            y_m: World y [m].
        """
        return (
            math.floor((y_m - self.origin_y_m) / self.resolution_m),
            math.floor((x_m - self.origin_x_m) / self.resolution_m),
        )

    def cells(self, xy_m: FloatingArray) -> tuple[Int64Array, Int64Array]:
        """Rows and columns of the cells that hold points (may lie outside of the grid), shape (N,) each.

        Args:
            xy_m: World x, y [m], shape (N, 2).
        """
        return (
            np.floor((xy_m[:, 1] - self.origin_y_m) / self.resolution_m).astype(np.int64),
            np.floor((xy_m[:, 0] - self.origin_x_m) / self.resolution_m).astype(np.int64),
        )

    @overload
    def centre_m(self, row: int, column: int) -> tuple[float, float]: ...

    @overload
    def centre_m(self, row: Int64Array, column: Int64Array) -> tuple[Float64Array, Float64Array]: ...

    def centre_m(self, row: Any, column: Any) -> tuple[Any, Any]:
        """World x, y of a cell's centre, or of the centres of cells [m].

        Args:
            row: Number of the cell along y, or numbers.
            column: Number of the cell along x, or numbers.
        """
        return (
            self.origin_x_m + (column + 0.5) * self.resolution_m,
            self.origin_y_m + (row + 0.5) * self.resolution_m,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class OccupancyMap:
    """Cells that an agent of one height must not touch; not inflated.

    A cell without floor (unknown, outside) counts as occupied for planning and judging alike.
    """

    frame: GridFrame
    """Frame of the grid's cells in the world."""
    occupied: BoolArray
    """True where something stands or no floor is known, shape (H, W); row 0 is the smallest y."""

    def __post_init__(self) -> None:
        check_array("occupied", self.occupied, np.bool_, (None, None))


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorMap:
    """Height of the local floor."""

    frame: GridFrame
    """Frame of the grid's cells in the world."""
    height_m: Float32Array
    """World z of the floor at cell centres [m], shape (H, W), finite everywhere (extrapolated beyond known floor)."""

    def __post_init__(self) -> None:
        check_array("height_m", self.height_m, np.float32, (None, None))

    def at(self, x_m: float, y_m: float) -> float:
        """Floor height [m] at a point, bilinear between cell centres, held constant beyond the grid.

        Args:
            x_m: World x [m].
            y_m: World y [m].
        """
        return float(self.at_many(np.array([[x_m, y_m]]))[0])

    def at_many(self, xy_m: Float64Array) -> Float64Array:
        """Floor heights [m] at points, shape (N,); see `at`.

        Args:
            xy_m: World x, y [m], shape (N, 2).
        """
        height, width = self.height_m.shape
        u = np.clip((xy_m[:, 0] - self.frame.origin_x_m) / self.frame.resolution_m - 0.5, 0.0, width - 1.0)
        v = np.clip((xy_m[:, 1] - self.frame.origin_y_m) / self.frame.resolution_m - 0.5, 0.0, height - 1.0)
        j = np.minimum(u.astype(np.int64), max(width - 2, 0))
        i = np.minimum(v.astype(np.int64), max(height - 2, 0))
        j1, i1 = np.minimum(j + 1, width - 1), np.minimum(i + 1, height - 1)
        a, b = u - j, v - i
        z = self.height_m
        low = (1 - a) * z[i, j].astype(np.float64) + a * z[i, j1]
        high = (1 - a) * z[i1, j].astype(np.float64) + a * z[i1, j1]
        heights: Float64Array = (1 - b) * low + b * high
        return heights


@kernel_with_cache
def bilinear(
    height_m: Float32Array, origin_x_m: float, origin_y_m: float, resolution_m: float, x_m: float, y_m: float
) -> float:
    """Floor height [m] at a point as `FloorMap.at`, for callers that are compiled themselves.

    Args:
        height_m: Height of the floor at cell centres [m], shape (H, W).
        origin_x_m: World x of the grid's corner [m].
        origin_y_m: World y of the grid's corner [m].
        resolution_m: Edge of a cell [m].
        x_m: World x [m].
        y_m: World y [m].
    """
    height, width = height_m.shape
    u = min(max((x_m - origin_x_m) / resolution_m - 0.5, 0.0), width - 1.0)
    v = min(max((y_m - origin_y_m) / resolution_m - 0.5, 0.0), height - 1.0)
    j, i = int(u), int(v)
    j1, i1, a, b = min(j + 1, width - 1), min(i + 1, height - 1), u - j, v - i
    low = (1.0 - a) * float(height_m[i, j]) + a * float(height_m[i, j1])
    high = (1.0 - a) * float(height_m[i1, j]) + a * float(height_m[i1, j1])
    value: float = (1.0 - b) * low + b * high
    return value
