import numpy as np
import pytest

from readygo.services.planner.humans.polyline import at_constant_speed, at_lengths, length_m, resample


def test_resampling_keeps_length_and_spacing():
    line = np.array([(0, 0), (3, 0), (3, 4)], float)
    even = resample(line, 71)
    assert length_m(line) == 7.0
    assert np.allclose(np.hypot(*np.diff(even, axis=0).T), 0.1)


def test_constant_speed_ends_at_the_end():
    walk = at_constant_speed(np.array([(0, 0), (3, 0)], float), 1.0, 0.05)
    assert walk[-1] == pytest.approx((3, 0))
    assert np.allclose(np.diff(walk[:-1, 0]), 0.05)


def test_points_at_lengths_lie_on_the_corners_and_the_ends_are_held():
    line = np.array([(0, 0), (3, 0), (3, 4)], float)
    assert at_lengths(line, np.array([-1.0, 0.0, 3.0, 5.0, 9.0])) == pytest.approx(
        np.array([(0, 0), (0, 0), (3, 0), (3, 2), (3, 4)], float)
    )
