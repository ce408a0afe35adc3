import numpy as np
import pytest

from readygo.common.episode.resample import at_rate, place_between
from readygo.common.messages import Motion


def walking(count=21):
    """One metre a second along x, turning about the vertical."""
    root_m = np.zeros((count, 3), np.float32)
    root_m[:, 0] = 0.05 * np.arange(count)
    pose = np.zeros((count, 24, 3), np.float32)
    pose[:, 0, 1] = 0.02 * np.arange(count)
    return Motion(root_m=root_m, pose_axis_angle=pose)


def test_motion_of_the_same_rate_is_left_alone():
    motion = walking()
    assert at_rate(motion, 20) is motion


@pytest.mark.parametrize("rate_hz", [30, 60])
def test_motion_is_the_same_at_every_time(rate_hz):
    motion = at_rate(walking(), rate_hz)
    times_s = np.arange(len(motion.root_m)) / rate_hz
    assert motion.rate_hz == rate_hz
    assert times_s[-1] == 1.0
    np.testing.assert_allclose(motion.root_m[:, 0], times_s, atol=1e-6)
    np.testing.assert_allclose(motion.pose_axis_angle[:, 0, 1], 0.4 * times_s, atol=1e-6)


def test_motion_that_ends_between_two_steps_is_held_there():
    motion = at_rate(walking(2), 30)
    assert motion.root_m[:, 0].tolist() == pytest.approx([0.0, 1 / 30, 0.05])


def test_place_is_exact_where_rows_and_steps_meet():
    assert [place_between(step, 30, 20) for step in (0, 3, 30)] == [(0, 0.0), (2, 0.0), (20, 0.0)]
    assert place_between(1, 30, 20) == (0, pytest.approx(2 / 3))
    assert [place_between(step, 20, 20) for step in (0, 7)] == [(0, 0.0), (7, 0.0)]
