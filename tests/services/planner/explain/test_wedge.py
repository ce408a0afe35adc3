"""The outline of what the camera sees."""

import math

import numpy as np
import pytest

from readygo.services.planner.explain.wedge import wedge_m

POSE = np.array([1.0, 2.0, math.pi / 2])
BORDERS = (-math.radians(50), math.radians(50))


def reach(outline):
    return np.hypot(*(outline[1:] - outline[0]).T)


def test_wedge_opens_by_the_field_of_view_around_the_heading():
    outline = wedge_m(POSE, BORDERS, 5.0)
    assert outline[0].tolist() == [1.0, 2.0]
    bearings = np.degrees(np.arctan2(*(outline[1:] - outline[0]).T[::-1]))
    assert (bearings.min(), bearings.max()) == (pytest.approx(40.0), pytest.approx(140.0))
    np.testing.assert_allclose(reach(outline), 5.0)


def test_wall_ends_the_sight_behind_it_alone():
    outline = wedge_m(POSE, BORDERS, 5.0, sees=lambda x, y: y < 4.0 or x < 1.0)
    ends = outline[1:]
    right = ends[:, 0] > 1.05
    assert np.all(ends[right, 1] < 4.0)
    assert ends[right & (np.abs(ends[:, 0] - 1.5) < 0.3), 1].min() > 3.9
    np.testing.assert_allclose(reach(outline)[ends[:, 0] < 0.95], 5.0)


def test_nothing_is_seen_from_behind_a_curtain():
    np.testing.assert_allclose(reach(wedge_m(POSE, BORDERS, 5.0, sees=lambda x, y: False)), 0.0)
