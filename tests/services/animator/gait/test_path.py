import numpy as np
import pytest

from readygo.benchmarks.motion.paths import dash, hard_stops, line, stop_and_go
from readygo.services.animator.gait.curves import default_curves
from readygo.services.animator.gait.human import draw_style
from readygo.services.animator.gait.path import heading, plan_track, time_of_phase

STYLE = draw_style(np.random.default_rng(0), 0.0, 1.0)


def track_of(xy, **style):
    """The track of a trajectory in the z-up world."""
    x, z = np.ascontiguousarray(xy[:, 0]), np.ascontiguousarray(-xy[:, 1])
    return plan_track(x, z, STYLE._replace(**style), 1.0, default_curves())


@pytest.mark.parametrize("cadence", [0.9, 1.1])
@pytest.mark.parametrize("path", [line(1.2), dash(2.8)], ids=["walk", "run"])
def test_humans_cadence_scales_the_rate_of_their_steps(path, cadence):
    rows = slice(60, 130)
    average, own = track_of(path), track_of(path, cadence=cadence)
    assert average.rate[rows].min() > 0.8
    assert own.rate[rows] == pytest.approx(cadence * average.rate[rows], rel=1e-9)
    strides = [np.ptp(track.phase[rows]) for track in (average, own)]
    assert strides[1] == pytest.approx(cadence * strides[0], rel=1e-6)


def test_time_of_a_phase_is_where_the_phase_is_reached():
    track = track_of(hard_stops(1.2, 3.0))
    assert len(track.bouts) == 2
    for bout, (first, last, _) in enumerate(track.bouts):
        for row in range(first, last + 1):
            assert time_of_phase(track, bout, track.phase[row]) == pytest.approx(0.05 * row, abs=1e-9)
        beyond = time_of_phase(track, bout, track.phase[last] + 0.5)
        assert beyond == pytest.approx(0.05 * last + 0.5 / track.rate[last])


def test_heading_is_held_in_a_stand_and_turned_before_setting_off():
    xy = stop_and_go(1.2)
    psi = heading(xy[:, 0].copy(), -xy[:, 1], 0.0)
    # y-up: 0 faces +z, which is -y of the z-up world; +x is a quarter turn to the left.
    assert psi[60] == pytest.approx(np.pi / 2, abs=0.02)
    assert psi[-1] == pytest.approx(np.pi, abs=0.02)
    assert np.abs(np.diff(psi)).max() <= 2.6 * 0.05 + 1e-9


def test_who_never_moves_faces_as_their_style_says():
    track = track_of(np.zeros((40, 2)), heading_rad=1.25)
    assert track.psi == pytest.approx(np.full(40, 1.25))
    assert len(track.bouts) == 0
