"""A scene's map as viewers show it: a grid for Foxglove, the same cells as points for Rerun."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2

from readygo.common.arrays import BoolArray, Float64Array, RecordArray
from readygo.common.dataset import labels, schemas
from readygo.common.dataset.markers import Rgb, cloud, coloured_points
from readygo.common.dataset.poses import pose_of

if TYPE_CHECKING:
    # The package of the maps loads numba, which readers of data need not wait for.
    from readygo.common.maps import FloorMap, OccupancyMap

CELL_MIN_M = 0.1
CELLS_MAX = 1 << 18
"""Cells are made larger until there are no more."""
FREE_RGB: Rgb = (200, 200, 200)
BLOCKED_RGB: Rgb = (90, 60, 60)
CELL_DTYPE = np.dtype([("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")])


class MapMessages(NamedTuple):
    """What a shard says of its scene, without a time."""

    grid: Any
    """For /map, a foxglove.Grid: floor and what blocks the robot at its border; all else is transparent."""
    points: Any
    """For /map/points: the same cells at the height of the floor, a foxglove.PointCloud."""


def map_messages(occupancy: "OccupancyMap", floor: "FloorMap") -> MapMessages:
    """The messages of a map.

    Args:
        occupancy: What blocks the robot, not inflated.
        floor: Height of the floor.
    """
    resolution_m = occupancy.frame.resolution_m
    size = max(
        1, math.ceil(CELL_MIN_M / resolution_m - 1e-6), math.ceil(math.sqrt(occupancy.occupied.size / CELLS_MAX))
    )
    free = ~_pool_cells(occupancy.occupied, size)
    blocked = _dilate(free) & ~free
    cell_m = size * resolution_m
    origin_m = np.array([occupancy.frame.origin_x_m, occupancy.frame.origin_y_m])
    points = [
        coloured_points(_on_floor(np.argwhere(cells), origin_m, cell_m, floor), rgb)
        for cells, rgb in ((free, FREE_RGB), (blocked, BLOCKED_RGB))
    ]
    return MapMessages(_grid(free, blocked, origin_m, cell_m, points[0]), cloud(np.concatenate(points), None))


def _pool_cells(occupied: BoolArray, size: int) -> BoolArray:
    """True for the squares of `size` cells that hold an occupied one; what is outside is occupied."""
    height, width = (-(-length // size) for length in occupied.shape)
    padded = np.ones((height * size, width * size), dtype=np.bool_)
    padded[: occupied.shape[0], : occupied.shape[1]] = occupied
    return np.asarray(padded.reshape(height, size, width, size).any(axis=(1, 3)))


def _dilate(cells: BoolArray) -> BoolArray:
    """`cells` and their eight neighbours."""
    padded = np.pad(cells, 1)
    rows, columns = cells.shape
    return np.asarray(np.any([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0))


def _on_floor(cells: npt.NDArray[np.intp], origin_m: Float64Array, cell_m: float, floor: "FloorMap") -> Float64Array:
    """Centres of cells (row, column) on the floor [m], shape (N, 3)."""
    xy_m = origin_m + (cells[:, ::-1] + 0.5) * cell_m
    row, column = floor.frame.cells(xy_m)
    rows, columns = floor.height_m.shape
    z_m = floor.height_m[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.column_stack([xy_m, z_m])


def _grid(
    free: BoolArray,
    blocked: BoolArray,
    origin_m: Float64Array,
    cell_m: float,
    floor_points: RecordArray,
) -> Any:
    """The grid, flat at the floor's median height."""
    cells = np.zeros(free.shape, dtype=CELL_DTYPE)
    cells[free] = (*FREE_RGB, 255)
    cells[blocked] = (*BLOCKED_RGB, 255)
    z_m = float(np.median(floor_points["z"])) if len(floor_points) else 0.0
    return Grid(
        frame_id=schemas.WORLD_FRAME,
        pose=pose_of(float(origin_m[0]), float(origin_m[1]), z_m, 0.0),
        column_count=free.shape[1],
        cell_size=Vector2(x=cell_m, y=cell_m),
        row_stride=free.shape[1] * CELL_DTYPE.itemsize,
        cell_stride=CELL_DTYPE.itemsize,
        fields=labels.layout(CELL_DTYPE),
        data=cells.tobytes(),
    )
