from pathlib import Path

import pytest

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig, RobotConfig, load_robot


def test_robot_file_holds_the_whole_camera(tmp_path: Path) -> None:
    text = "v_max_mps = 0.7\n[camera]\nwidth_px = 320\nhorizontal_fov_deg = 90\ndistortion = 'fisheye'\nk1 = 0.01\n"
    (tmp_path / "robot.toml").write_text(text + "mount_x_m = 0.1\nexposure_s = 0.01\nlatency_s = 0.1\n")
    camera = CameraConfig(
        width_px=320,
        horizontal_fov_deg=90.0,
        distortion="fisheye",
        k1=0.01,
        mount_x_m=0.1,
        exposure_s=0.01,
        latency_s=0.1,
    )
    assert load_robot(tmp_path / "robot.toml") == RobotConfig(v_max_mps=0.7, camera=camera)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed = 1.0", "Unknown key 'speed'"),
        ("v_max_mps = 'fast'", "v_max_mps must be float"),
        ("v_max_mps = -1", "v_max_mps must be positive"),
        ("[camera]\nwidth_px = 2", "image size must be 8..4095"),
        ("radius_m = 0.5", "planning_radius_m 0.3 is below"),
        ("= 3", "cannot be read"),
        ("[camera]\nlens = 'wide'", "Unknown key 'camera.lens'"),
        ("[camera]\ndistortion = 'brown_conrady'\nk1 = -0.4", "folds the image"),
        ("[cameras.rear]\n[cameras.left]\ndistortion = 'brown_conrady'\nk1 = -0.4", "folds the image"),
        ("[camera]\n[cameras.front]", "two cameras are called 'front'"),
        ("[cameras.front]\n[cameras.front]", "cannot be read"),
        ("[cameras.front]\n[cameras.'Left side']", "a-z, 0-9 and _, a letter first, got 'Left side'"),
        ("[cameras.front]\n[cameras.left]\nlatency_s = 0.1", "'left' has latency_s 0.1, 'front' 0"),
        ("[cameras.front]\n" + "".join(f"[cameras.c{k}]\n" for k in range(8)), "up to 8 cameras, got 9"),
        ("cameras = 3", "cameras must be a table"),
        ("[cameras]\nleft = 3", "cameras.left must be a table, got 3"),
        ("[cameras.left]\nlens = 'wide'", "Unknown key 'cameras.left.lens'"),
    ],
)
def test_wrong_robot_file_is_refused_with_a_reason(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        load_robot(tmp_path / "robot.toml")
    assert str(caught.value).startswith(f"Robot file {tmp_path / 'robot.toml'}")
    assert "\n" not in str(caught.value)


def test_camera_of_a_file_without_one_is_the_given_camera(tmp_path: Path) -> None:
    path, given = tmp_path / "robot.toml", CameraConfig(mount_height_m=0.9)
    path.write_text("v_max_mps = 0.5\n")
    assert load_robot(path).camera == CameraConfig()
    other = RobotConfig(camera=given, cameras={"rear": given})
    assert load_robot(path, cameras_of=other) == RobotConfig(v_max_mps=0.5, camera=given, cameras={"rear": given})
    path.write_text("[camera]\nmount_height_m = 0.7\n")
    assert load_robot(path, cameras_of=other) == RobotConfig(camera=CameraConfig(mount_height_m=0.7))


def test_first_of_several_cameras_is_the_one_that_others_stand_beside(tmp_path: Path) -> None:
    path, rear = tmp_path / "robot.toml", CameraConfig(mount_yaw_deg=180.0)
    path.write_text("[cameras.ahead]\n[cameras.rear]\nmount_yaw_deg = 180.0\n")
    robot = load_robot(path)
    assert robot == RobotConfig(camera_name="ahead", cameras={"rear": rear})
    assert robot.all_cameras == {"ahead": CameraConfig(), "rear": rear}
    path.write_text("[camera]\n[cameras.rear]\nmount_yaw_deg = 180.0\n")
    assert load_robot(path) == RobotConfig(cameras={"rear": rear})
    assert section_from_mapping(RobotConfig, section_to_mapping(robot)) == robot


def test_missing_robot_file_is_a_config_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml cannot be read: No such file or directory\.$"):
        load_robot(tmp_path / "none.toml")


@pytest.mark.parametrize(
    "text", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a = 0x" + b"f" * 5000, b"a = '\xff'"]
)
def test_file_beyond_a_limit_is_refused_in_one_line(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "robot.toml").write_bytes(text)
    with pytest.raises(ConfigError, match=r"^Robot file .*robot\.toml cannot be read: .*\.$"):
        load_robot(tmp_path / "robot.toml")


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert {name: value for name, value in section_to_mapping(RobotConfig()).items() if name not in ("camera",)} == {
        "radius_m": 0.25,
        "planning_radius_m": 0.3,
        "height_m": 0.6,
        "v_max_mps": 1.0,
        "v_min_mps": 0.0,
        "w_max_radps": 1.2,
        "a_max_mps2": 1.0,
        "alpha_max_radps2": 3.0,
        "control_hz": 20,
        "camera_hz": 20,
        "camera_name": "front",
        "cameras": {},
        "ranges": {
            "mount_height_m": [],
            "horizontal_fov_deg": [],
            "mount_pitch_deg": [],
            "radius_m": [],
            "v_max_mps": [],
            "w_max_radps": [],
        },
    }
