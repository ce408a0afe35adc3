import numpy as np
import pytest

from readygo.common.episode.grid_search import FREE
from readygo.common.maps import GridFrame
from readygo.services.planner.expert.cost_factors import (
    open_around,
    paint_capsule,
    paint_points,
    paint_slope,
    path_cost,
    path_distance,
    segment_distance,
    static_factor,
)

GRID = GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.1)


def free():
    return np.full((40, 50), FREE, np.uint8)


def centres():
    rows, columns = np.mgrid[0:40, 0:50]
    return GRID.origin_x_m + (columns + 0.5) * 0.1, GRID.origin_y_m + (rows + 0.5) * 0.1


def test_ground_nearer_than_allowed_is_blocked_and_the_strip_beyond_it_falls_off():
    clearance = np.array([[0.2, 0.3, 0.3001, 0.4, 0.5, 2.0]])
    factor = static_factor(clearance, 0.3, wall_cost=0.5, wall_distance_m=0.2)
    assert factor.tolist() == [[0, 0, 6, 5, 4, 4]]


@pytest.mark.parametrize(
    ("point", "distance"), [((0.5, 0.3), 0.3), ((-0.3, 0.4), 0.5), ((1.4, -0.3), 0.5), ((0.2, 0.0), 0.0)]
)
def test_distance_to_a_segment(point, distance):
    assert segment_distance(*point, 0.0, 0.0, 1.0, 0.0) == pytest.approx(distance)


def test_distance_to_a_point_as_a_segment():
    assert segment_distance(3.0, 4.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(5.0)


def test_capsule_covers_what_is_within_its_radius_and_leaves_blocked_cells():
    factor = free()
    factor[20, 20] = 0
    paint_capsule(factor, GRID, (0.0, 4.0, 2.0, 4.0), 0.45, 40)
    x, y = centres()
    inside = np.hypot(x - np.clip(x, 0.0, 2.0), y - 4.0) < 0.45
    assert np.array_equal(factor == 40, inside & (np.arange(2000).reshape(40, 50) != 20 * 50 + 20))
    assert factor[20, 20] == 0


def test_slope_rises_to_the_value_on_the_segment_and_never_lowers():
    factor = free()
    factor[20, 15] = 50
    paint_slope(factor, GRID, (0.55, 4.05, 0.55, 4.05), 0.5, 24)
    assert factor[20, 15] == 50
    other = free()
    paint_slope(other, GRID, (0.55, 4.05, 0.55, 4.05), 0.5, 24)
    assert other[20, 15:21].tolist() == pytest.approx([24, 20, 16, 12, 8, 4], abs=1)
    assert np.all(np.diff(other[20, 15:21].astype(int)) < 0)


def test_points_are_painted_with_the_larger_factor_and_a_block_wins():
    factor = free()
    paint_points(factor, GRID, np.array([[0.05, 3.05], [0.06, 3.04]]), 0.25, 30)
    assert (factor == 30).sum() == 21
    paint_points(factor, GRID, np.array([[0.05, 3.05]]), 0.15, 10)
    assert (factor == 10).sum() == 0
    paint_points(factor, GRID, np.array([[0.05, 3.05]]), 0.15, 0)
    assert (factor == 0).sum() == 9


def test_blocked_ground_around_the_robot_opens_where_it_has_room():
    factor, clearance = np.zeros((40, 50), np.uint8), np.full((40, 50), 0.25)
    clearance[:, 12:] = 0.2
    open_around(factor, GRID, clearance, (0.05, 4.05), 0.22, 40)
    assert factor[20, 10] == 40
    assert factor[20, 6] == 40
    assert factor[20, 5] == 0
    assert factor[20, 12] == 0


def test_nearest_of_some_path_points():
    path = np.array([[0.0, 0.0, 0, 1], [1.0, 0.0, 0, 1], [2.0, 0.0, 0, 1]])
    ends = (2.0, 1.0, 3.0, 1.0)
    assert path_distance(path, 0, 9, ends) == pytest.approx(1.0)
    assert path_distance(path, 0, 2, ends) == pytest.approx(np.hypot(1, 1))
    assert path_distance(path, 3, 9, ends) == np.inf


def test_path_costs_length_by_slowness_by_factor():
    path = np.array([[0.05, 3.05, 0, 1.0], [0.55, 3.05, 0, 1.0], [1.05, 3.05, 0, 0.5]])
    factor = free()
    assert path_cost(path, 0, factor, GRID, 1.0) == pytest.approx(0.5 + 2 * 0.5)
    assert path_cost(path, 1, factor, GRID, 1.0) == pytest.approx(1.0)
    factor[10, 15] = 2 * FREE
    assert path_cost(path, 0, factor, GRID, 1.0) == pytest.approx(2 * 0.5 + 2 * 0.5)
    factor[10, 15] = 0
    assert path_cost(path, 0, factor, GRID, 1.0) == np.inf
    assert path_cost(path - (5.0, 0, 0, 0), 0, free(), GRID, 1.0) == np.inf


def test_painted_ground_is_as_it_was(golden_figures):
    """Slopes, capsules, points and an opening on ground of random clearance, some of it beyond the edge."""
    rng = np.random.default_rng(3)
    clearance = rng.uniform(0.0, 0.9, (40, 50))
    factor = static_factor(clearance, 0.23, wall_cost=0.8, wall_distance_m=0.3)
    paint_slope(factor, GRID, (-0.4, 3.1, 1.7, 4.9), 0.73, 37)
    paint_capsule(factor, GRID, (2.2, 2.4, 4.3, 1.8), 0.41, 23)
    paint_points(factor, GRID, rng.uniform((-1.2, 1.9), (4.1, 6.2), (9, 2)), 0.34, 29)
    paint_points(factor, GRID, rng.uniform((-1.2, 1.9), (4.1, 6.2), (4, 2)), 0.27, 0)
    open_around(factor, GRID, clearance, (1.33, 4.41), 0.11, 17)
    golden_figures("expert/painted ground", factor.reshape(-1), scale=0.2)
    path = np.column_stack(
        [np.linspace(-0.7, 2.9, 60), np.linspace(2.2, 5.7, 60), np.zeros(60), np.linspace(-0.9, 0.9, 60)]
    )
    open_ground = np.maximum(factor, 3).astype(np.uint8)
    costs = [path_cost(path, first, open_ground, GRID, 0.8) for first in range(0, 60, 7)]
    gaps = [path_distance(path, first, first + 9, (0.3, 4.0, 1.9, 2.7)) for first in range(0, 60, 7)]
    golden_figures("expert/paths on it", costs, gaps)
