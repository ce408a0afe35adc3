import math

import numpy as np
import pytest

from readygo.services.animator.gait import curves as gait_curves
from readygo.services.animator.gait.curves import (
    ARM_FLEXION,
    HIP_SWAY,
    curve_at,
    default_curves,
    gain_of,
    stride_rate,
    swing_of_body,
    weights_of,
)


def test_shares_of_the_clips_sum_to_one_and_choose_the_speed():
    curves = default_curves()
    for speed, run in ((0.0, 0.0), (1.3, 0.0), (2.0, 0.4), (3.0, 1.0)):
        assert weights_of(curves, speed, run).sum() == pytest.approx(1.0)
    assert weights_of(curves, curves.speed[0], 0.0) == pytest.approx([1.0, 0.0, 0.0])
    assert weights_of(curves, 0.5 * (curves.speed[0] + curves.speed[1]), 0.0) == pytest.approx([0.5, 0.5, 0.0])
    assert weights_of(curves, 3.0, 1.0) == pytest.approx([0.0, 0.0, 1.0])


def test_curves_pass_through_their_samples_without_corners():
    table = default_curves().swing_pitch
    weights = np.array([1.0, 0.0, 0.0])
    ends = np.arange(gait_curves.SAMPLES) / (gait_curves.SAMPLES - 1)
    assert [curve_at(table, weights, x) for x in ends] == pytest.approx(table[0])
    slopes = [
        [(curve_at(table, weights, x + d) - curve_at(table, weights, x + d - 1e-5)) / 1e-5 for d in (0.0, 1e-5)]
        for x in ends[1:-1]
    ]
    assert np.abs(np.diff(slopes, axis=1)).max() < 0.01


def test_swings_begin_and_end_as_stances_end_and_begin():
    curves = default_curves()
    assert curves.swing_pitch[:, 0] == pytest.approx(curves.stance_pitch[:, -1])
    assert curves.swing_pitch[:, -1] == pytest.approx(curves.stance_pitch[:, 0])
    assert curves.swing_way[:, 0] == pytest.approx(0.0)
    assert curves.swing_way[:, -1] == pytest.approx(1.0)


def test_runners_step_more_often_than_the_walk_that_they_leave():
    assert 120.0 * stride_rate(2.9, 1.0, 1.0) == pytest.approx(157.0, rel=0.03)
    assert stride_rate(3.5, 1.0, 1.0) > stride_rate(2.5, 1.0, 1.0)


@pytest.mark.parametrize("size", [0.7, 1.0, 1.25])
@pytest.mark.parametrize("speed_mps", [0.4, 1.2, 1.6, 1.9, 2.4])
def test_strides_are_those_of_the_fits_at_the_same_speed_for_the_legs(size, speed_mps):
    """Legs of another length walk alike at the same Froude number: speeds and rates go with its root."""
    v = speed_mps / math.sqrt(size)
    x = min(max((v - 1.45) / 0.55, 0.0), 1.0)
    share = 0.5 + 0.5 * (10 * x**3 - 15 * x**4 + 6 * x**5)
    cadence, from_step = 66.4 + 38.9 * v, 60 * v / (0.158 + 0.417 * v)
    walking = cadence**share * from_step ** (1 - share)
    running = 157 + 7 * (v - 2.75)
    for run in (0.0, 0.3, 1.0):
        steps_per_min = ((1 - run) * walking + run * running) / math.sqrt(size)
        assert stride_rate.py_func(speed_mps, size, run) == pytest.approx(steps_per_min / 120)


def test_steps_are_as_long_as_those_of_the_clips_and_shorter_below_the_slowest():
    curves = default_curves()
    for speed, run in (
        (curves.speed[0], 0.0),
        (0.5 * (curves.speed[0] + curves.speed[1]), 0.0),
        (curves.speed[2], 1.0),
    ):
        assert gain_of(curves, weights_of(curves, speed, run), speed, run) == pytest.approx(1.0)
    slow = 0.4 * curves.speed[0]
    step = slow / stride_rate(slow, 1.0, 0.0) * stride_rate(curves.speed[0], 1.0, 0.0) / curves.speed[0]
    assert gain_of(curves, weights_of(curves, slow, 0.0), slow, 0.0) == pytest.approx(step)
    assert 0.3 < step < 0.9
    assert gain_of(curves, weights_of(curves, 5.0, 0.0), 5.0, 0.0) == 1.2
    assert gain_of(curves, weights_of(curves, 0.0, 0.0), 0.0, 0.0) == 0.0


@pytest.mark.parametrize("channel", [ARM_FLEXION, HIP_SWAY])
def test_body_swings_as_the_fourier_series_of_the_mixed_clips(channel):
    curves, weights = default_curves(), np.array([0.2, 0.5, 0.3])
    _, cosines, sines = np.split(weights @ curves.body[:, channel], [1, 5])
    for cycle in (0.0, 0.13, 0.5, 0.9, 7.13):
        angles = 2 * np.pi * cycle * np.arange(1, 5)
        expected = cosines @ np.cos(angles) + sines @ np.sin(angles)
        assert swing_of_body(curves.body, weights, channel, cycle) == pytest.approx(expected)


def test_shares_choose_the_two_clips_about_a_speed_and_end_at_the_fastest_walk():
    curves = default_curves()
    for speed in (0.0, 0.9 * curves.speed[0], 0.3 * curves.speed[0] + 0.7 * curves.speed[1], 1.5 * curves.speed[1]):
        u = min(max((speed - curves.speed[0]) / (curves.speed[1] - curves.speed[0]), 0.0), 1.0)
        assert weights_of(curves, speed, 0.3) == pytest.approx([0.7 * (1 - u), 0.7 * u, 0.3])
    walks = curves._replace(**{name: getattr(curves, name)[:2] for name in curves._fields[1:]})
    assert weights_of(walks, 9.0, 0.4) == pytest.approx([0.0, 1.0])
