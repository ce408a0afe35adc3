import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import DT_S, RATE_HZ, STEP_NS


@given(st.floats(-1, 1), st.floats(-1.2, 1.2), st.floats(-3, 3))
def test_arc_equals_many_small_straight_steps(v: float, w: float, yaw: float) -> None:
    x = y = 0.0
    heading, steps = yaw, 2000
    for _ in range(steps):
        heading += w * 0.05 / steps / 2
        x += v * 0.05 / steps * math.cos(heading)
        y += v * 0.05 / steps * math.sin(heading)
        heading += w * 0.05 / steps / 2
    # Near 1e-9 rad/s the ends of an arc of 10^9 m cancel.
    assert step_unicycle(0.0, 0.0, yaw, v, w, 0.05) == pytest.approx(
        (x, y, heading), abs=1e-8 if abs(w) > 1e-7 else 5e-7
    )


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(0, 1), st.floats(-1.2, 1.2))
def test_executed_command_keeps_all_limits(v: float, w: float, v0: float, w0: float) -> None:
    robot = RobotConfig()
    v1, w1 = limit_command(v, w, v0, w0, robot, 0.05)
    assert -1e-12 <= v1 <= robot.v_max_mps
    assert abs(w1) <= robot.w_max_radps
    assert abs(v1 - v0) <= robot.a_max_mps2 * 0.05 + 1e-12
    assert abs(w1 - w0) <= robot.alpha_max_radps2 * 0.05 + 1e-12


def test_command_within_reach_is_executed_as_it_is() -> None:
    assert limit_command(0.53, -0.1, 0.5, 0.0, RobotConfig(), 0.05) == (0.53, -0.1)


def test_robot_that_reverses_is_held_to_its_speed_backwards() -> None:
    robot = RobotConfig(v_min_mps=-0.3)
    assert limit_command(-1.0, 0.0, 0.0, 0.0, robot, 0.05) == (-0.05, 0.0)
    assert limit_command(-1.0, 0.0, -0.28, 0.0, robot, 0.05) == (-0.3, 0.0)
    assert limit_command(-1.0, 0.0, 0.0, 0.0, RobotConfig(), 0.05) == (0.0, 0.0)


def test_rates_of_those_who_name_none_agree() -> None:
    assert STEP_NS * RATE_HZ == 10**9
    assert DT_S * RATE_HZ == 1.0


@settings(deadline=None, derandomize=True)
@given(st.floats(-0.4, 0.8), st.floats(-1.2, 1.2), st.floats(-9, 9), st.sampled_from([10, 25, 60]))
def test_arc_from_a_place_at_every_step_length_turns_about_its_centre(
    v: float, w: float, yaw: float, rate: int
) -> None:
    x, y, after = step_unicycle(3.1, -2.7, yaw, v, w, 1 / rate)
    assert after == pytest.approx(yaw + w / rate)
    # The chord lies at the middle heading, and is as long as a chord of the arc is.
    chord = v / rate * (math.sin(0.5 * w / rate) / (0.5 * w / rate) if abs(w) > 1e-6 else 1.0)
    middle = yaw + 0.5 * w / rate
    assert (x, y) == pytest.approx((3.1 + chord * math.cos(middle), -2.7 + chord * math.sin(middle)), abs=1e-6)


@settings(deadline=None, derandomize=True)
@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-0.4, 0.8), st.floats(-0.7, 0.7), st.sampled_from([0.02, 0.1]))
def test_executed_command_is_the_nearest_that_limits_allow(v: float, w: float, v0: float, w0: float, dt: float) -> None:
    robot = RobotConfig(v_max_mps=0.8, v_min_mps=-0.4, w_max_radps=0.7, a_max_mps2=0.6, alpha_max_radps2=1.3)
    v1, w1 = limit_command(v, w, v0, w0, robot, dt)
    allowed_v = np.clip(np.linspace(v0 - 0.6 * dt, v0 + 0.6 * dt, 4001), -0.4, 0.8)
    allowed_w = np.clip(np.linspace(w0 - 1.3 * dt, w0 + 1.3 * dt, 4001), -0.7, 0.7)
    assert v1 == pytest.approx(allowed_v[np.abs(allowed_v - v).argmin()], abs=1e-3 * dt)
    assert w1 == pytest.approx(allowed_w[np.abs(allowed_w - w).argmin()], abs=1e-3 * dt)
