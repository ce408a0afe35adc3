import numpy as np
import pytest

from readygo.services.animator.gait import curves as gait_curves
from readygo.services.animator.gait.curves import curve_at, default_curves, stride_rate, weights_of


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
