import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.grid import FAR_M, NEAR_M, SHAPE, peaks, polar_grid


def test_columns_span_the_view_and_rings_are_equally_wide_in_proportion() -> None:
    grid = polar_grid(CameraConfig())
    rings, columns = SHAPE
    edge = np.degrees(np.arctan(np.tan(np.radians(50)) * (1 - 1 / columns)))
    assert np.degrees(grid.bearings_rad[[0, -1]]) == pytest.approx([edge, -edge])
    ratios = grid.distances_m[1:] / grid.distances_m[:-1]
    assert ratios == pytest.approx(np.full(rings - 1, (FAR_M / NEAR_M) ** (1 / rings)))
    assert np.log(ratios[0]) == pytest.approx(grid.ring_step)
    assert grid.distances_m[0] > NEAR_M
    assert grid.distances_m[-1] < FAR_M


def test_bearing_falls_into_the_nearest_column() -> None:
    grid = polar_grid(CameraConfig())
    assert grid.column_of(grid.bearings_rad + 0.005).tolist() == list(range(SHAPE[1]))
    assert grid.column_of(np.array([2.0, -2.0])).tolist() == [0, SHAPE[1] - 1]


def test_peaks_are_likelier_than_their_neighbours_and_come_in_order() -> None:
    presence = np.zeros(SHAPE)
    presence[3, 5], presence[3, 6], presence[0, 31], presence[9, 9] = 0.6, 0.5, 0.9, 0.2
    assert peaks(presence, 0.3).tolist() == [[0, 31], [3, 5]]
    assert peaks(presence, 0.95).shape == (0, 2)
