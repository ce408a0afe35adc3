import numpy as np
import pytest
from scipy.interpolate import BSpline

from readygo.services.planner.humans.spline import distance_at, smooth_path, spline_basis, spline_points
from tests.services.planner.worlds import FRAME


def test_basis_equals_scipys():
    first, weights = spline_basis(11, 60)
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, 9), np.ones(3)])
    control = np.random.default_rng(0).normal(size=(11, 2))
    expected = BSpline(knots, control, 3)(np.linspace(0, 1, 60))
    assert np.allclose(spline_points(control, first, weights), expected, atol=1e-12)


def _smooth(route, clearance):
    return smooth_path(
        np.array(route, float),
        clearance,
        FRAME,
        spacing_m=0.4,
        preferred_m=0.6,
        required_m=0.35,
        factors=(200.0, 2.0, 0.02),
        iterations=60,
    )


def _clearance_of_disc(centre, radius):
    y, x = np.mgrid[0:120, 0:160]
    return np.hypot(
        FRAME.origin_x_m + (x + 0.5) * 0.05 - centre[0], FRAME.origin_y_m + (y + 0.5) * 0.05 - centre[1]
    ) - (radius)


def test_path_bends_around_a_disc_and_keeps_its_ends():
    clearance = _clearance_of_disc((1.0, 5.0), 0.5)
    path = _smooth([(-1.5, 5.1), (1.0, 5.2), (3.5, 5.1)], clearance)
    assert np.allclose(path[[0, -1]], [(-1.5, 5.1), (3.5, 5.1)])
    assert np.hypot(*(path - (1.0, 5.0)).T).min() >= 0.5 + 0.34
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(path, axis=0).T[::-1])))
    assert np.abs(turns).max() < 0.35


def test_path_through_a_wall_is_given_up():
    clearance = np.full((120, 160), 0.2)
    assert _smooth([(-1.5, 5.1), (3.5, 5.1)], clearance) is None


def test_gradient_is_the_slope_of_the_objective_and_paths_are_as_they_were(golden_figures):
    clearance = _clearance_of_disc((1.1, 5.3), 0.4)
    route = np.array([(-1.4, 5.0), (0.2, 5.6), (1.3, 4.5), (3.4, 5.9)])
    golden_figures("humans/spline", _smooth(route, clearance), _smooth(route, clearance)[::-1])
    places = np.random.default_rng(5).uniform((1.0, 1.0), (150.0, 110.0), (60, 2))
    golden_figures("humans/clearances", [distance_at(clearance, x, y) for x, y in places.tolist()])
    for x, y in places.tolist():
        if min(abs((x - 0.5) % 1), abs((y - 0.5) % 1)) > 1e-3:
            _, along_x, along_y = distance_at(clearance, x, y)
            rise_x = distance_at(clearance, x + 1e-4, y)[0] - distance_at(clearance, x - 1e-4, y)[0]
            rise_y = distance_at(clearance, x, y + 1e-4)[0] - distance_at(clearance, x, y - 1e-4)[0]
            assert (along_x, along_y) == pytest.approx((rise_x / 2e-4, rise_y / 2e-4), abs=1e-6)
