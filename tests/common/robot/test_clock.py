import math
from fractions import Fraction

import pytest

from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.clock import make_clock


def test_step_is_the_longest_that_divides_both_periods_and_is_no_longer_than_a_twentieth():
    rates = {
        (20, 20): 20,
        (10, 10): 20,
        (30, 10): 30,
        (10, 30): 30,
        (30, 20): 60,
        (20, 10): 20,
        (15, 5): 30,
        (60, 60): 60,
    }
    clocks = {pair: make_clock(*pair) for pair in rates}
    assert {pair: clock.rate_hz for pair, clock in clocks.items()} == rates
    for (control_hz, camera_hz), clock in clocks.items():
        assert clock.control_every * control_hz == clock.image_every * camera_hz == clock.rate_hz
    assert RobotConfig().clock == Clock()


def test_times_do_not_drift_where_a_step_is_no_whole_number_of_nanoseconds():
    clock = make_clock(30, 10)
    assert [clock.time_ns(step) for step in (1, 2, 3, 30)] == [33_333_333, 66_666_666, 100_000_000, 10**9]
    assert [clock.steps(time_s) for time_s in (0.0, 0.1, 0.5, 1.01)] == [0, 3, 15, 30]


def test_commands_and_images_come_at_their_own_steps():
    clock = make_clock(10, 20)
    assert [step for step in range(5) if clock.commands(step)] == [0, 2, 4]
    assert [clock.held_for(step) for step in range(4)] == [2, 1, 2, 1]
    slow = make_clock(30, 10)
    assert [step for step in range(9) if slow.sees(step, 1)] == [0, 1, 4, 7]
    assert [slow.image_step(step, 1) for step in range(9)] == [0, 0, 0, 0, 3, 3, 3, 6, 6]


def test_spacing_is_a_multiple_of_the_time_between_images():
    assert [Clock().spacing_steps(spacing_s) for spacing_s in (0.05, 0.3, 0.5)] == [1, 6, 10]
    assert make_clock(30, 10).spacing_steps(0.5) == 15
    for spacing_s in (0.0, 0.02, 0.07, -0.5):
        with pytest.raises(ValueError, match=r"multiple of 0\.05 s"):
            Clock().spacing_steps(spacing_s)
    with pytest.raises(ValueError, match=r"multiple of 0\.1 s"):
        make_clock(30, 10).spacing_steps(0.25)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"control_hz": 0}, r"control_hz must be 1\.\.120, got 0"),
        ({"camera_hz": 500}, r"camera_hz must be 1\.\.120, got 500"),
        ({"control_hz": 17}, r"control_hz 17 and camera_hz 20 need 340 steps a second to meet"),
        ({"control_hz": 12.5}, r"control_hz must be int, got 12\.5"),
        ({"v_min_mps": 0.3}, r"v_min_mps is the largest speed backwards: -1 \(v_max_mps\) to 0, got 0\.3"),
        ({"v_min_mps": -2.0}, r"v_min_mps is the largest speed backwards"),
    ],
)
def test_rates_and_speeds_that_make_no_sense_are_refused_in_a_line(wrong, words):
    with pytest.raises(ConfigError, match=words):
        section_from_mapping(RobotConfig, wrong)


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(10, 30), (30, 20), (15, 10), (60, 24), (25, 50)])
def test_commands_images_and_delays_are_those_of_counting_on_the_time_axis(control_hz, camera_hz):
    """Times as fractions: commands at multiples of 1/control_hz, images at multiples of 1/camera_hz."""
    clock = make_clock(control_hz, camera_hz)
    times = [Fraction(step, clock.rate_hz) for step in range(240)]
    commanded = [(time * control_hz).denominator == 1 for time in times]
    pictured = [(time * camera_hz).denominator == 1 for time in times]
    assert [clock.commands(step) for step in range(240)] == commanded
    for step in range(200):
        assert clock.held_for(step) == next(k for k in range(1, 99) if commanded[step + k])
        for late in (0, 1, 4, 7):
            assert clock.sees(step, late) == (
                step == 0
                or (step >= late and pictured[step - late])
                or (step < late and (step - late) % clock.image_every == 0)
            )
            newest = max((k for k in range(step - late + 1) if pictured[k]), default=0)
            assert clock.image_step(step, late) == newest
        assert clock.time_ns(step) == math.floor(times[step] * 10**9)
    for time_s in (0.0, 0.04, 0.26, 0.5, 1.3):
        apart = [k for k in range(1, 200) if pictured[k]]
        nearest = min(abs(times[k] - Fraction(time_s)) for k in apart)
        assert abs(times[clock.nearest_images(time_s)] - Fraction(time_s)) == pytest.approx(float(nearest), abs=1e-12)
        assert pictured[clock.nearest_images(time_s)]


def test_rates_that_need_too_many_steps_or_are_none_are_refused_at_their_limits():
    assert (make_clock(1, 1).rate_hz, make_clock(120, 120).rate_hz, make_clock(40, 60).rate_hz) == (20, 120, 120)
    for rates in ((0, 20), (20, 0), (121, 20), (20, 121), (50, 60)):
        with pytest.raises(ValueError, match=r"must be 1\.\.120|at most 120"):
            make_clock(*rates)
