"""The map in a shard: a grid, and the same cells as points."""

import numpy as np

from readygo.common.dataset.markers import POINT_DTYPE
from readygo.common.dataset.scene_map import BLOCKED_RGB, CELL_DTYPE, CELLS_MAX, FREE_RGB, map_messages
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from tests.common.dataset.maps import make_maps


def cells_of(grid) -> np.ndarray:
    cells = np.frombuffer(grid.data, dtype=CELL_DTYPE).reshape(-1, grid.column_count)
    assert (grid.row_stride, grid.cell_stride) == (4 * grid.column_count, 4)
    return np.stack([cells[name] for name in CELL_DTYPE.names], axis=-1)


def test_grid_shows_the_floor_and_what_is_beside_it() -> None:
    maps = make_maps()
    grid = map_messages(maps.robot, maps.floor).grid
    cells = cells_of(grid)
    assert (grid.frame_id, cells.shape[:2], grid.cell_size.x, grid.cell_size.y) == ("world", (40, 80), 0.1, 0.1)
    assert (grid.pose.position.x, grid.pose.position.y) == (-2.0, -1.0)
    assert cells[10, 10].tolist() == [*FREE_RGB, 255]
    assert cells[20, 40].tolist() == [*BLOCKED_RGB, 255]
    assert cells[1, 10].tolist() == [*BLOCKED_RGB, 255]
    assert cells[0, 10].tolist() == [0, 0, 0, 0]


def test_points_are_the_same_cells_on_the_floor() -> None:
    maps = make_maps()
    grid, cloud = map_messages(maps.robot, maps.floor)
    points = np.frombuffer(cloud.data, dtype=POINT_DTYPE)
    cells = cells_of(grid)
    assert len(points) == np.count_nonzero(cells[..., 3])
    rgb = np.stack([points[name] for name in ("red", "green", "blue")], axis=-1)
    columns, rows = (np.floor((points[axis] - low) / 0.1).astype(int) for axis, low in (("x", -2.0), ("y", -1.0)))
    assert (cells[rows, columns, :3] == rgb).all()
    np.testing.assert_allclose(points["z"], 0.16 * (points["x"] + 2.0) / 8.0, atol=2e-3)
    assert abs(grid.pose.position.z - np.median(points["z"])) < 2e-3


def test_large_maps_get_larger_cells() -> None:
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.2)
    occupied = np.zeros((1100, 900), dtype=np.bool_)
    floor = FloorMap(frame=frame, height_m=np.zeros(occupied.shape, dtype=np.float32))
    cells = cells_of(map_messages(OccupancyMap(frame=frame, occupied=occupied), floor).grid)
    assert cells.shape[0] * cells.shape[1] <= CELLS_MAX
    assert cells.shape[:2] == (550, 450)


def test_a_map_without_floor_is_empty() -> None:
    maps = make_maps()
    maps.robot.occupied[:] = True
    grid, cloud = map_messages(maps.robot, maps.floor)
    assert not cells_of(grid).any()
    assert cloud.data == b""
