import math

import numpy as np
import pytest

from readygo.common.maps import GridFrame, OccupancyMap, clearance_m, farthest_m, free_components, largest_free_area

FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.05)


def brute_force(occupied):
    padded = np.pad(occupied, 1, constant_values=True)
    blocked = np.argwhere(padded) - 1
    out = np.zeros(occupied.shape)
    for i, j in np.argwhere(~occupied):
        gap = np.maximum(np.abs(blocked - (i, j)) - 0.5, 0.0)
        out[i, j] = np.sqrt((gap**2).sum(axis=1).min()) * 0.05
    return out


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 1.0])
def test_clearance_is_the_distance_to_the_nearest_occupied_square(share):
    occupied = np.random.default_rng(1).random((23, 31)) < share
    found = clearance_m(OccupancyMap(frame=FRAME, occupied=occupied))
    np.testing.assert_allclose(found, brute_force(occupied), atol=1e-6)


def test_disc_next_to_a_wall_touches_from_its_edge_not_its_centre():
    occupied = np.zeros((41, 41), np.bool_)
    occupied[:, 20] = True
    found = clearance_m(OccupancyMap(frame=FRAME, occupied=occupied))
    assert found[20, 21] == pytest.approx(0.025)
    assert found[20, 24] == pytest.approx(0.175)


def test_diagonal_neighbour_is_a_corner_away():
    occupied = np.zeros((9, 9), np.bool_)
    occupied[4, 4] = True
    assert clearance_m(OccupancyMap(frame=FRAME, occupied=occupied))[5, 5] == pytest.approx(math.hypot(0.025, 0.025))


def test_components_are_ordered_by_size_and_join_over_edges_only():
    free = np.zeros((6, 8), np.bool_)
    free[0, :2] = True
    free[1, 2] = True
    free[3:5, 3:8] = True
    labels, sizes = free_components(free)
    assert sizes.tolist() == [48 - 13, 10, 2, 1]
    assert labels[3, 3] == 1
    assert labels[0, 0] == 2
    assert labels[1, 2] == 3
    assert labels[5, 0] == 0


def test_wide_disc_does_not_pass_a_narrow_door():
    occupied = np.zeros((40, 80), np.bool_)
    occupied[:, 40] = True
    occupied[15:25, 40] = False
    occupancy = OccupancyMap(frame=FRAME, occupied=occupied)
    cells, both_m2 = largest_free_area(occupancy, 0.20)
    _, one_m2 = largest_free_area(occupancy, 0.30)
    assert both_m2 > 2 * one_m2 > 0
    assert cells[20, 10]
    assert cells[20, 70]


@pytest.mark.parametrize(("radius_m", "cells"), [(0.375, 0), (0.375 - 2**-20, 8)])
def test_disc_that_touches_both_walls_of_a_corridor_does_not_stand_clear(radius_m, cells):
    # Multiples of 1/8 m are exact: three cells wide, half of that is the radius.
    occupied = np.ones((5, 10), np.bool_)
    occupied[1:4, :] = False
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.25)
    found, area_m2 = largest_free_area(OccupancyMap(frame=frame, occupied=occupied), radius_m)
    assert int(found.sum()) == cells
    assert area_m2 == cells * 0.0625


def test_blocked_map_has_no_area():
    cells, area_m2 = largest_free_area(OccupancyMap(frame=FRAME, occupied=np.ones((5, 5), np.bool_)), 0.1)
    assert area_m2 == 0.0
    assert not cells.any()


def test_farthest_distance_is_within_one_area():
    labels = np.zeros((40, 60), np.int32)
    labels[5:8, 10:50] = 1
    labels[30:35, 10:20] = 2
    assert farthest_m(labels, 0.1) == pytest.approx(3.9, rel=0.02)
    assert farthest_m(np.zeros((4, 4), np.int32), 0.1) == 0.0
