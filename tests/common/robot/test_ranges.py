from pathlib import Path

import pytest

from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig, RobotConfig, load_robot
from readygo.common.robot.ranges import RobotRanges

RANGES = RobotRanges(radius_m=(0.1, 0.2), v_max_mps=(0.4, 0.8), mount_height_m=(0.2, 0.9))


def test_file_names_ranges_and_a_robot_of_them_has_its_values(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(
        "radius_m = 0.3\nplanning_radius_m = 0.4\n"
        "[ranges]\nradius_m = [0.1, 0.2]\nv_max_mps = [0.4, 0.8]\nmount_height_m = [0.2, 0.9]\n"
    )
    robot = load_robot(tmp_path / "robot.toml")
    assert robot.ranges == RANGES
    one = robot.with_values({"radius_m": 0.15, "v_max_mps": 0.5, "mount_height_m": 0.3})
    camera = CameraConfig(mount_height_m=0.3)
    assert one.planning_radius_m == pytest.approx(0.25)
    assert one == RobotConfig(radius_m=0.15, planning_radius_m=one.planning_radius_m, v_max_mps=0.5, camera=camera)
    assert robot.with_values({}) is robot
    assert robot.widest.planning_radius_m == pytest.approx(0.3)
    assert RobotConfig().widest == RobotConfig()


def test_robot_of_a_range_reverses_as_the_same_share_of_its_speed() -> None:
    robot = RobotConfig(v_max_mps=1.0, v_min_mps=-0.5, ranges=RobotRanges(v_max_mps=(0.4, 1.2)))
    assert robot.with_values({"v_max_mps": 0.4}).v_min_mps == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[ranges]\nv_max_mps = [1.0, 0.5]", r"ranges\.v_max_mps must be \[lowest, highest\]"),
        ("[ranges]\nv_max_mps = [0.0, 0.5]", r"ranges\.v_max_mps must be positive"),
        ("[ranges]\nmount_height_m = [0.1, 20.0]", r"ranges\.mount_height_m must be 0\.\.10"),
        ("[ranges]\nhorizontal_fov_deg = [5.0, 90.0]", r"ranges\.horizontal_fov_deg must be 10\.\.170"),
        ("[ranges]\nlength_m = [0.1, 0.2]", "Unknown key 'ranges.length_m'"),
        (
            "[ranges]\nhorizontal_fov_deg = [80.0, 90.0]\n[camera]\ndistortion = 'fisheye'\nk1 = 0.01",
            r"ranges\.horizontal_fov_deg needs a camera without distortion",
        ),
        ("[ranges]\nradius_m = [0.1, 0.2]\n[camera]\n[cameras.rear]", "ranges are for robots of one camera"),
    ],
)
def test_wrong_ranges_are_refused_in_a_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        load_robot(tmp_path / "robot.toml")
    assert "\n" not in str(caught.value)
