import math

import numpy as np
import pytest

from readygo.common.episode import meets_obstacle
from readygo.common.episode.collision import meets_human
from readygo.common.maps import GridFrame, OccupancyMap


@pytest.mark.parametrize(
    ("x", "y", "meets"),
    [
        (3.76, 1.02, True),
        (3.74, 1.02, False),
        (4.29, 1.02, True),
        (4.31, 1.02, False),
        (4.02, 1.29, True),
        (4.02, 1.31, False),
    ],
)
def test_disc_meets_the_sides_of_a_cell(hall, x, y, meets):
    assert meets_obstacle(hall, x, y, 0.25) is meets


def test_disc_meets_the_corner_of_a_cell_at_its_true_distance(hall):
    for angle in (0.1, 0.7, 1.4):
        for distance, meets in ((0.249, True), (0.251, False)):
            x, y = 4.05 + distance * math.cos(angle), 1.05 + distance * math.sin(angle)
            assert meets_obstacle(hall, x, y, 0.25) is meets


@pytest.mark.parametrize(("dx_m", "dy_m"), [(-0.5, 0.125), (0.125, -0.5), (0.0, -0.5)])
def test_disc_that_touches_a_side_exactly_meets_it(dx_m, dy_m):
    # Multiples of 1/8 m are exact: the disc's edge is the cell's edge, not about it.
    occupied = np.zeros((20, 20), np.bool_)
    occupied[8, 12] = True
    cells = OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.25), occupied=occupied)
    x, y = -1.0 + 12 * 0.25 + dx_m, 2.0 + 8 * 0.25 + dy_m
    assert meets_obstacle(cells, x, y, 0.5)
    assert not meets_obstacle(cells, x, y, 0.5 - 2**-20)


def test_outside_of_the_grid_is_occupied(hall):
    assert meets_obstacle(hall, 50.0, 0.0, 0.25)
    assert meets_obstacle(hall, -0.8, 0.0, 0.25)


def test_agrees_with_the_distance_to_every_square(hall):
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(hall.occupied)
    low_x, low_y = hall.frame.origin_x_m + columns * 0.05, hall.frame.origin_y_m + rows * 0.05
    for x, y, radius in rng.uniform((-0.9, -1.9, 0.05), (8.9, 3.9, 1.0), (300, 3)):
        dx = np.maximum(np.maximum(low_x - x, x - low_x - 0.05), 0)
        dy = np.maximum(np.maximum(low_y - y, y - low_y - 0.05), 0)
        assert meets_obstacle(hall, x, y, radius) == (np.hypot(dx, dy).min() <= radius)


def test_humans_are_met_below_the_sum_of_the_radii():
    humans = np.array([[3.0, 0.0], [0.0, 0.5]])
    assert not meets_human(0.0, 0.0, humans, 0.5)
    assert meets_human(0.0, 0.001, humans, 0.5)
    assert not meets_human(0.0, 0.0, np.empty((0, 2)), 0.5)
