import numpy as np
import pytest

from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.timing import (
    ACCELERATION_MPS2,
    WAIT_MAX_S,
    cut_to_meet,
    first_rows,
    nearest_along,
    nearest_m,
    time_path,
    timed_to_meet,
)

LINE = np.array([[0.0, 0.0], [6.0, 0.0]])


def speeds(xy_m):
    return np.hypot(*np.diff(xy_m, axis=0).T) / DT_S


def test_walk_goes_at_its_speed_and_slows_down_for_its_end_within_the_acceleration():
    xy = time_path(LINE, 1.2)
    v = speeds(xy)
    assert v[:60] == pytest.approx(1.2)
    assert xy[-1] == pytest.approx((6.0, 0.0))
    assert np.abs(np.diff(v)).max() <= ACCELERATION_MPS2 * DT_S + 0.081
    left = 6.0 - xy[:-1, 0]
    assert np.all(v**2 <= 2 * ACCELERATION_MPS2 * left + 0.02)


def test_pause_is_at_its_place_and_as_long_as_asked():
    xy = time_path(LINE, 1.0, pauses=[(2.5, 2.0)])
    still = np.flatnonzero(speeds(xy) < 1e-9)
    assert len(still) == 40
    assert xy[still][:, 0] == pytest.approx(2.5)


def test_who_waits_starts_from_rest():
    xy = time_path(LINE, 1.2, wait_s=1.0)
    v = speeds(xy)
    assert np.flatnonzero(v > 0)[0] == 20
    assert v[20] == pytest.approx(ACCELERATION_MPS2 * DT_S)


@pytest.mark.parametrize("meeting_s", [2.0, 5.0, 7.0])
def test_who_is_to_meet_is_there_in_time_by_coming_later_or_waiting(meeting_s):
    xy = timed_to_meet(LINE, (4.0, 0.3), meeting_s, 1.0)
    assert xy[round(meeting_s / DT_S), 0] == pytest.approx(4.0, abs=0.12)


def test_nobody_waits_longer_than_allowed():
    assert timed_to_meet(LINE, (4.0, 0.0), 4.0 + WAIT_MAX_S + 1.0, 1.0) is None


def test_cut_leaves_what_is_wanted_before_the_meeting_or_tells_that_too_little_is_there():
    cut = cut_to_meet(LINE, (4.0, 0.0), 1.5, slack_m=0.0)
    assert cut[0, 0] == pytest.approx(2.5, abs=0.06)
    assert cut[-1] == pytest.approx((6.0, 0.0))
    assert cut_to_meet(LINE, (1.0, 0.0), 1.5, slack_m=0.3) is None
    assert cut_to_meet(LINE, (1.0, 0.0), 1.5, slack_m=0.6)[0] == pytest.approx((0.0, 0.0))


def test_nearest_along_is_in_even_steps():
    even, index, spacing_m = nearest_along(LINE, (1.02, 2.0))
    assert spacing_m == pytest.approx(6.0 / (len(even) - 1))
    assert spacing_m <= 0.05
    assert even[index, 0] == pytest.approx(1.02, abs=0.5 * spacing_m)


def test_nearest_is_at_the_same_time_and_who_has_arrived_stands():
    a = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    b = np.array([[2.0, 0.0], [2.0, 3.0], [2.0, 3.0], [2.0, 2.0], [2.0, 0.5]])
    assert nearest_m(a, b) == pytest.approx(0.5)
    assert first_rows(a, 5).tolist() == [*a.tolist(), [2.0, 0.0], [2.0, 0.0]]
    assert first_rows(a, 2).tolist() == a[:2].tolist()


def test_walks_on_a_bent_path_are_as_they_were(golden_figures):
    path = np.array([[0.3, -0.2], [2.1, 0.4], [2.6, 2.9], [0.7, 4.4], [-1.9, 3.8]])
    golden_figures("humans/timed", time_path(path, 1.13, wait_s=0.7, pauses=[(1.7, 0.85), (5.2, 2.3)]))
    for meeting_s in (1.2, 3.7, 6.1, 11.0):
        met = timed_to_meet(path, (2.3, 2.2), meeting_s, 0.87)
        golden_figures(f"humans/met {meeting_s}", np.zeros((1, 2)) if met is None else met)
    for before_m in (0.7, 2.9, 9.0):
        cut = cut_to_meet(path, (1.5, 3.6), before_m, slack_m=0.31)
        golden_figures(f"humans/cut {before_m}", np.zeros((1, 2)) if cut is None else cut)
    along, index, length_m = nearest_along(path, (1.4, 3.1))
    golden_figures("humans/nearest", [*np.ravel(along)[:8], index, length_m])
    golden_figures("humans/first rows", first_rows(path, 9), first_rows(path, 9) * [2.0, 1.0])
    assert first_rows(path, 9)[4:] == pytest.approx(np.tile(path[-1], (5, 1)))
    assert nearest_m(path, path + np.array([0.3, 0.4])) == pytest.approx(
        min(np.hypot(*(a - b - [0.3, 0.4])) for a in path for b in path)
    )
