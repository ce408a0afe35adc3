import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig, RobotConfig, limit_command, load_robot, save_robot, step_unicycle


def test_robot_file_round_trips(tmp_path: Path) -> None:
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(width_px=320, horizontal_fov_deg=90.0))
    save_robot(robot, tmp_path / "robot.toml")
    assert load_robot(tmp_path / "robot.toml") == robot


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed = 1.0", "Unknown key 'speed'"),
        ("v_max_mps = 'fast'", "v_max_mps must be float"),
        ("v_max_mps = -1", "v_max_mps must be positive"),
        ("[camera]\nwidth_px = 2", "image size must be 8..4095"),
        ("radius_m = 0.5", "planning_radius_m 0.3 is below"),
        ("= 3", "cannot be read"),
    ],
)
def test_wrong_robot_file_is_refused_with_a_reason(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_robot(tmp_path / "robot.toml")


def test_missing_robot_file_is_a_config_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_robot(tmp_path / "none.toml")


def test_camera_looks_along_the_robots_x_axis_and_level() -> None:
    T = CameraConfig().T_world_camera(1.0, 2.0, math.pi / 2, 0.1)
    forward, left, up = np.array([0, 1, 0]), np.array([-1, 0, 0]), np.array([0, 0, 1])
    np.testing.assert_allclose(T[:3, 2], forward, atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], -left, atol=1e-12)
    np.testing.assert_allclose(T[:3, 1], -up, atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [1.0, 2.0, 0.6])


def test_horizontal_field_of_view_reaches_the_image_border() -> None:
    camera = CameraConfig(horizontal_fov_deg=100.0)
    K = camera.K_px
    assert math.degrees(2 * math.atan(camera.width_px / 2 / K[0, 0])) == pytest.approx(100.0)
    assert (K[0, 2], K[1, 2]) == (128.0, 72.0)


@given(st.floats(-1, 1), st.floats(-1.2, 1.2), st.floats(-3, 3))
def test_arc_equals_many_small_straight_steps(v: float, w: float, yaw: float) -> None:
    x = y = 0.0
    heading, steps = yaw, 2000
    for _ in range(steps):
        heading += w * 0.05 / steps / 2
        x += v * 0.05 / steps * math.cos(heading)
        y += v * 0.05 / steps * math.sin(heading)
        heading += w * 0.05 / steps / 2
    assert step_unicycle(0.0, 0.0, yaw, v, w) == pytest.approx((x, y, heading), abs=1e-8)


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(0, 1), st.floats(-1.2, 1.2))
def test_executed_command_keeps_all_limits(v: float, w: float, v0: float, w0: float) -> None:
    robot = RobotConfig()
    v1, w1 = limit_command(v, w, v0, w0, robot)
    assert -1e-12 <= v1 <= robot.v_max_mps
    assert abs(w1) <= robot.w_max_radps
    assert abs(v1 - v0) <= robot.a_max_mps2 * 0.05 + 1e-12
    assert abs(w1 - w0) <= robot.alpha_max_radps2 * 0.05 + 1e-12
