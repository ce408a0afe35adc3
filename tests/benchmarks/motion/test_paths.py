import numpy as np
import pytest

from readygo.benchmarks.motion import paths


def speeds(xy):
    return np.linalg.norm(np.diff(xy, axis=0), axis=1) / 0.05


@pytest.mark.parametrize("make", [paths.line, paths.circle, paths.s_curve, paths.reversal])
def test_steady_paths_have_the_speed_asked_for(make):
    xy = make(1.2)
    assert len(xy) == 200
    assert speeds(xy) == pytest.approx(np.full(199, 1.2), rel=2e-3)


def test_line_has_its_middle_at_the_origin_and_the_circle_its_radius():
    assert paths.line(1.0)[100] == pytest.approx([0.0, 0.0])
    assert np.hypot(*paths.circle(1.0, 2.0).T) == pytest.approx(np.full(200, 2.0))
    (x, y), (next_x, next_y) = np.diff(paths.circle(1.0), axis=0)[:2]
    assert x * next_y - y * next_x > 0


@pytest.mark.parametrize("make", [paths.stop_and_go, paths.turn_in_place, paths.dash])
def test_eased_paths_reach_their_speed_and_stand_in_between(make):
    speed = speeds(make(1.4))
    assert speed.max() == pytest.approx(1.4)
    assert speed[:5] == pytest.approx(np.zeros(5))
    assert np.abs(np.diff(speed)).max() < 0.2


def test_turns_are_where_the_names_say():
    for make, angle_deg in ((paths.stop_and_go, 90.0), (paths.turn_in_place, 135.0)):
        xy = make(1.0)
        before, after = xy[60] - xy[50], xy[-1] - xy[-10]
        cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
        assert np.degrees(np.arccos(cosine)) == pytest.approx(angle_deg)
    back = paths.reversal(1.0)
    assert back[-1] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert back[:, 0].max() == pytest.approx(5.0)


def test_hard_stops_pause_without_easing():
    speed = speeds(paths.hard_stops(2.0, 1.0))
    assert len(speed) == 139
    assert set(np.round(speed, 6)) == {0.0, 2.0}
    assert (speed == 0.0).sum() == 20


def test_floor_has_its_height_in_the_middle_of_cells():
    ground = paths.floor(lambda x, y: 0.1 * x + 0.2 * y, half_m=2.0)
    assert ground.height_m.shape == (40, 40)
    assert ground.at(0.05, 1.05) == pytest.approx(0.215, abs=1e-5)
    assert paths.floor().at(3.0, 4.0) == 0.0
