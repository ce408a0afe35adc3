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


def test_outline_is_in_the_order_of_bearings_up_to_the_last_place_seen(golden_figures):
    """Unlike borders, a pose off the origin, and a round pillar: along each ray, all places before the end are seen."""
    pose, borders = np.array([-1.3, 0.7, 2.5]), (-0.41, 0.93)

    def sees(x, y):
        return math.hypot(x + 3.1, y - 1.6) > 0.45

    outline = wedge_m(pose, borders, 4.3, sees=sees)
    assert len(outline) == 1 + math.ceil((0.93 + 0.41) / math.radians(1.0)) + 1
    bearings = np.unwrap(np.arctan2(*(outline[1:] - outline[0]).T[::-1]))
    np.testing.assert_allclose(bearings - bearings[0], np.linspace(0.0, 1.34, len(bearings)), atol=1e-9)
    assert math.remainder(bearings[0] - (2.5 - 0.41), math.tau) == pytest.approx(0.0, abs=1e-9)
    for bearing, reach_m in zip(bearings, reach(outline), strict=True):
        steps_m = 0.05 * np.arange(1, 87)
        seen = [sees(-1.3 + s * math.cos(bearing), 0.7 + s * math.sin(bearing)) for s in steps_m]
        hidden_m = steps_m[seen.index(False)] if False in seen else math.inf
        # Coarse steps of 0.2 m may jump over a narrow part of the pillar.
        assert reach_m == pytest.approx(4.3 if hidden_m > 4.3 else hidden_m - 0.05, abs=1e-6) or reach_m > hidden_m
    golden_figures("explain/wedge", outline)
