import pytest

from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.state_policy.robots import robot_difference


def test_other_pixels_of_the_same_view_are_no_difference() -> None:
    small = CameraConfig(height_px=72, width_px=128, latency_s=0.1)
    assert robot_difference(RobotConfig(), RobotConfig(camera=small)) == ""


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (RobotConfig(v_max_mps=0.5), "v_max_mps is 1.0, here 0.5"),
        (RobotConfig(camera=CameraConfig(horizontal_fov_deg=60.0)), "its cameras show something else"),
        (RobotConfig(cameras={"left": CameraConfig(mount_yaw_deg=90.0)}), "its cameras show something else"),
    ],
)
def test_first_difference_is_named(robot: RobotConfig, words: str) -> None:
    assert robot_difference(RobotConfig(), robot) == words
