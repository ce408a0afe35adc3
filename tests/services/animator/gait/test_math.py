import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from readygo.common.maps import FloorMap, GridFrame
from readygo.services.animator.gait import math as gait
from readygo.services.animator.gait.math import Ground

ANGLES = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)


@pytest.mark.parametrize(("turn", "axis"), [(gait.rot_x, "x"), (gait.rot_y, "y"), (gait.rot_z, "z")])
def test_turns_about_axes_are_right_handed(turn, axis):
    for angle in (-2.0, 0.3, 1.5):
        assert turn(angle) == pytest.approx(Rotation.from_euler(axis, angle).as_matrix())


@settings(deadline=None)
@given(ANGLES, ANGLES)
def test_products_are_those_of_matrices(a, b):
    A, B = (Rotation.from_rotvec(v).as_matrix() for v in (a, b))
    assert gait.mat_mul(A, B) == pytest.approx(A @ B)
    assert gait.mat_t_mul(A, B) == pytest.approx(A.T @ B)
    assert gait.mat_vec(A, b) == pytest.approx(A @ b)
    assert gait.norm(b) == pytest.approx(np.linalg.norm(b))


@settings(deadline=None)
@given(ANGLES)
def test_axis_angle_gives_the_rotation_back(v):
    R, out = Rotation.from_rotvec(v).as_matrix(), np.empty(3)
    gait.axis_angle_of(R, out)
    assert Rotation.from_rotvec(out).as_matrix() == pytest.approx(R, abs=1e-7)
    assert np.linalg.norm(out) <= math.pi + 1e-9


def test_frame_has_its_y_axis_and_leans_to_the_hint():
    y, hint = np.array([0.2, 2.0, -0.4]), np.array([0.3, 0.9, 1.0])
    F = gait.frame_of(y, hint)
    assert pytest.approx(np.eye(3)) == F.T @ F
    assert np.linalg.det(F) == pytest.approx(1.0)
    assert F[:, 1] == pytest.approx(y / np.linalg.norm(y))
    assert F[:, 0] @ hint == pytest.approx(0.0, abs=1e-12)
    assert F[:, 2] @ hint > 0


def test_ease_rises_from_0_to_1_with_flat_ends():
    x = np.linspace(-0.2, 1.2, 141)
    y = np.array([gait.ease(value) for value in x])
    assert (y[x <= 0] == 0).all()
    assert y[x >= 1] == pytest.approx(1.0)
    assert gait.ease(0.5) == pytest.approx(0.5)
    assert (np.diff(y) >= -1e-12).all()
    assert gait.ease(0.01) < 1e-4


def test_wrapped_angle_is_equal_modulo_a_turn():
    for angle in np.linspace(-12.0, 12.0, 49):
        wrapped = gait.wrap(angle)
        assert abs(wrapped) <= math.pi + 1e-12
        assert math.remainder(wrapped - angle, math.tau) == pytest.approx(0.0, abs=1e-12)


def test_smoothing_keeps_levels_and_slopes_and_spreads_a_peak():
    assert gait.smooth(np.full(9, 2.5), 2.0) == pytest.approx(np.full(9, 2.5))
    ramp = 0.1 * np.arange(40)
    assert gait.smooth(ramp, 2.0)[10:30] == pytest.approx(ramp[10:30])
    peak = np.zeros(41)
    peak[20] = 1.0
    smoothed = gait.smooth(peak, 2.0)
    assert smoothed.sum() == pytest.approx(1.0)
    assert smoothed[20] == pytest.approx(1 / (2.0 * math.sqrt(math.tau)), rel=0.01)
    assert smoothed[18] / smoothed[20] == pytest.approx(math.exp(-0.5), rel=1e-6)


def test_curve_above_a_series_is_nowhere_below_it():
    x = np.random.default_rng(0).normal(size=80).cumsum()
    above = gait.smooth_above(x, 2.0)
    assert (above >= x - 1e-12).all()
    assert (above > x).mean() > 0.9
    assert above.max() <= x.max() + 1e-12


def test_series_is_linear_between_its_samples_and_held_at_its_ends():
    x = np.array([1.0, 3.0, 2.0])
    values = [gait.sample(x, at) for at in (-1.0, 0.0, 0.25, 1.5, 2.0, 9.0)]
    assert values == pytest.approx([1.0, 1.0, 1.5, 2.5, 2.0, 2.0])
    assert gait.sample(np.array([4.0]), 0.7) == 4.0


def test_soft_maximum_is_the_larger_value_away_from_the_crossing():
    assert gait.soft_max(1.0, 3.0, 0.05) == pytest.approx(3.0)
    assert gait.soft_max(2.0, 2.0, 0.05) == pytest.approx(2.0 + 0.05 * math.log(2.0))
    assert gait.soft_max(1.0, 3.0, 0.0) == 3.0


def test_floor_under_a_point_of_the_y_up_world_is_the_maps():
    height = np.random.default_rng(1).normal(size=(7, 9)).astype(np.float32)
    floor = FloorMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.5), height_m=height)
    ground = Ground(height, -1.0, 2.0, 0.5)
    for x, y in np.random.default_rng(2).uniform((-2.0, 1.0), (4.5, 6.5), (60, 2)):
        assert gait.floor_at(ground, x, -y) == pytest.approx(floor.at(x, y), abs=1e-6)
