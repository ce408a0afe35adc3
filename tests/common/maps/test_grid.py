import numpy as np
import pytest

from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.maps.grid import bilinear

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.5)


def test_cell_holds_its_lower_edges_and_its_centre():
    assert FRAME.cell(-1.0, 2.0) == (0, 0)
    assert FRAME.cell(-0.51, 3.99) == (3, 0)
    assert FRAME.cell(-1.01, 1.99) == (-1, -1)
    for row, column in ((0, 0), (3, 7), (-2, 1)):
        assert FRAME.cell(*FRAME.centre_m(row, column)) == (row, column)


def test_floor_between_cell_centres_is_bilinear():
    rows, columns = np.mgrid[0:5, 0:6]
    height = (0.3 * columns - 0.2 * rows + 0.1 * rows * columns).astype(np.float32)
    floor = FloorMap(frame=FRAME, height_m=height)
    rng = np.random.default_rng(0)
    for u, v in rng.uniform((0, 0), (5, 4), (50, 2)):
        x, y = -1.0 + 0.5 * (u + 0.5), 2.0 + 0.5 * (v + 0.5)
        i, j = int(v), int(u)
        a, b = u - j, v - i
        low = (1 - a) * height[i, j] + a * height[i, j + 1]
        high = (1 - a) * height[i + 1, j] + a * height[i + 1, j + 1]
        assert floor.at(x, y) == pytest.approx((1 - b) * low + b * high, abs=1e-6)


def test_floor_is_held_beyond_the_outermost_centres():
    floor = FloorMap(frame=FRAME, height_m=np.float32([[0.0, 1.0], [2.0, 4.0]]))
    points = np.array([(-9.0, -9.0), (9.0, -9.0), (-9.0, 9.0), (9.0, 9.0), (-0.5, 9.0), (9.0, 2.5)])
    assert floor.at_many(points).tolist() == [0.0, 1.0, 2.0, 4.0, 3.0, 2.5]


def test_floor_of_one_cell_is_level():
    floor = FloorMap(frame=FRAME, height_m=np.float32([[0.75]]))
    assert floor.at_many(np.array([(-0.75, 2.25), (4.0, -3.0)])).tolist() == [0.75, 0.75]


def test_arrays_of_another_type_or_shape_are_refused():
    with pytest.raises(ValueError, match="occupied"):
        OccupancyMap(frame=FRAME, occupied=np.zeros((3, 3), np.uint8))
    with pytest.raises(ValueError, match="height_m"):
        FloorMap(frame=FRAME, height_m=np.zeros(3, np.float32))


def test_compiled_interpolation_is_that_of_the_floor_map():
    rng = np.random.default_rng(3)
    floor = FloorMap(frame=FRAME, height_m=rng.uniform(-0.2, 0.2, (5, 6)).astype(np.float32))
    for x, y in rng.uniform((-3, 0), (4, 7), (50, 2)):
        assert bilinear(floor.height_m, -1.0, 2.0, 0.5, x, y) == pytest.approx(floor.at(x, y), abs=1e-12)


def test_cells_and_centres_of_many_are_those_of_each():
    frame, rng = GridFrame(origin_x_m=-1.3, origin_y_m=0.7, resolution_m=0.05), np.random.default_rng(0)
    xy_m = rng.uniform(-3.0, 3.0, (200, 2))
    rows, columns = frame.cells(xy_m)
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == [frame.cell(x, y) for x, y in xy_m.tolist()]
    x_m, y_m = frame.centre_m(rows, columns)
    each = [frame.centre_m(*cell) for cell in zip(rows.tolist(), columns.tolist(), strict=True)]
    assert list(zip(x_m.tolist(), y_m.tolist(), strict=True)) == each
