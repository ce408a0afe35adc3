import math
from dataclasses import replace

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError
from readygo.common.frames import matrix_from_axis_angle

FOCAL = {"fx_px": 120.0, "fy_px": 118.0, "cx_px": 131.0, "cy_px": 70.5}


def test_camera_looks_along_the_robots_x_axis_and_level() -> None:
    T = CameraConfig().T_world_camera(1.0, 2.0, math.pi / 2, 0.1)
    forward, left, up = np.array([0, 1, 0]), np.array([-1, 0, 0]), np.array([0, 0, 1])
    np.testing.assert_allclose(T[:3, 2], forward, atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], -left, atol=1e-12)
    np.testing.assert_allclose(T[:3, 1], -up, atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [1.0, 2.0, 0.6])


def test_mount_moves_the_camera_with_the_robot_and_pitch_looks_down() -> None:
    camera = CameraConfig(mount_x_m=0.2, mount_y_m=0.1, mount_height_m=0.8, mount_pitch_deg=30.0)
    T = camera.T_world_camera(1.0, 2.0, math.pi / 2, 0.1)
    np.testing.assert_allclose(T[:3, 3], [0.9, 2.2, 0.9])
    np.testing.assert_allclose(T[:3, 2], [0.0, math.cos(math.radians(30)), -0.5], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert camera.place_m(1.0, 2.0, math.pi / 2) == pytest.approx((0.9, 2.2))


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, 2.0, -1.1])
def test_pose_of_a_level_camera_has_the_bytes_that_it_always_had(yaw_rad: float) -> None:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    expected = np.array([[s, 0.0, c, 1.5], [-c, 0.0, s, -2.5], [0.0, -1.0, 0.0, 0.75], [0.0, 0.0, 0.0, 1.0]])
    assert CameraConfig().T_world_camera(1.5, -2.5, yaw_rad, 0.25).tobytes() == expected.tobytes()


def test_horizontal_field_of_view_reaches_the_image_border() -> None:
    camera = CameraConfig(horizontal_fov_deg=100.0)
    K = camera.K_px
    assert math.degrees(2 * math.atan(camera.width_px / 2 / K[0, 0])) == pytest.approx(100.0)
    assert (K[0, 2], K[1, 2]) == (128.0, 72.0)
    assert camera == CameraConfig()


def test_intrinsics_are_given_in_one_way() -> None:
    camera = CameraConfig(**FOCAL)
    assert camera.horizontal_fov_deg is None
    assert camera.K_px.tolist() == [[120.0, 0.0, 131.0], [0.0, 118.0, 70.5], [0.0, 0.0, 1.0]]
    assert section_from_mapping(CameraConfig, section_to_mapping(camera)) == camera
    assert replace(camera, mount_height_m=0.3).fx_px == 120.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({**FOCAL, "horizontal_fov_deg": 90.0}, "either horizontal_fov_deg or fx_px, fy_px, cx_px, cy_px, got both"),
        ({"fx_px": 120.0}, "belong together; fy_px, cx_px, cy_px is missing"),
        ({**FOCAL, "fy_px": -1.0}, "fy_px must be a positive"),
        ({"horizontal_fov_deg": 5.0}, "horizontal_fov_deg must be 10..170"),
        ({"width_px": 2}, "image size must be 8..4095"),
        ({"exposure_s": -0.01}, r"exposure_s must be 0\.\.0\.05 s, got -0\.01"),
        ({"k1": 0.1}, 'k1 has no meaning with distortion "none"'),
        ({"distortion": "brown_conrady", "k4": 0.1}, "k4 has no meaning"),
        ({"distortion": "barrel"}, "distortion must be one of"),
        ({"k1": float("nan")}, "k1 must be a finite number"),
        ({"vignetting": 1.5}, "vignetting must be 0..1"),
        ({"red_gain": 0.0}, "red_gain must be"),
        ({"mount_pitch_deg": 90.0}, "mount_pitch_deg must be -89..89"),
        ({"latency_s": -0.1}, r"latency_s must be 0\.\.1 s"),
        ({"sharpness": 1}, "Unknown key 'camera.sharpness'"),
    ],
)
def test_wrong_values_are_refused_in_one_line(wrong, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        section_from_mapping(CameraConfig, wrong, where="camera.")
    assert "\n" not in str(caught.value)


def test_ideal_is_what_the_rasterizer_draws_and_nothing_else() -> None:
    assert CameraConfig().ideal
    assert CameraConfig(**FOCAL, mount_pitch_deg=10.0, latency_s=0.1).ideal
    for optics in ({"exposure_ev": 0.1}, {"distortion": "fisheye"}, {"readout_s": 0.01}, {"red_gain": 1.1}):
        assert not CameraConfig(**optics).ideal


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(CameraConfig()) == {
        "height_px": 144,
        "width_px": 256,
        "horizontal_fov_deg": 100.0,
        "fx_px": None,
        "fy_px": None,
        "cx_px": None,
        "cy_px": None,
        "distortion": "none",
        "k1": 0.0,
        "k2": 0.0,
        "k3": 0.0,
        "k4": 0.0,
        "p1": 0.0,
        "p2": 0.0,
        "mount_x_m": 0.0,
        "mount_y_m": 0.0,
        "mount_height_m": 0.5,
        "mount_yaw_deg": 0.0,
        "mount_pitch_deg": 0.0,
        "exposure_ev": 0.0,
        "red_gain": 1.0,
        "blue_gain": 1.0,
        "vignetting": 0.0,
        "shot_noise": 0.0,
        "read_noise": 0.0,
        "exposure_s": 0.0,
        "readout_s": 0.0,
        "latency_s": 0.0,
        "depth_min_m": 0.0,
        "depth_max_m": 10.0,
        "depth_noise": 0.0,
        "depth_lost": 0.0,
    }


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("exposure_ev", -8.0, 8.0), ("red_gain", 0.1, 10.0), ("blue_gain", 0.1, 10.0), ("vignetting", 0.0, 1.0),
        ("shot_noise", 0.0, 1.0), ("read_noise", 0.0, 1.0), ("exposure_s", 0.0, 0.05), ("readout_s", 0.0, 0.05),
        ("mount_x_m", -5.0, 5.0), ("mount_y_m", -5.0, 5.0), ("mount_height_m", 0.0, 10.0),
        ("mount_yaw_deg", -180.0, 180.0), ("mount_pitch_deg", -89.0, 89.0), ("latency_s", 0.0, 1.0),
        ("depth_max_m", 0.1, 65.0), ("depth_noise", 0.0, 0.1), ("depth_lost", 0.0, 0.9),
        ("horizontal_fov_deg", 10.0, 170.0), ("height_px", 8, 4095), ("width_px", 8, 4095),
    ],
)  # fmt: skip
def test_limits_are_allowed_and_what_is_beyond_them_is_not(name: str, low: float, high: float) -> None:
    words = "image size" if name.endswith("_px") else name
    for value, step in ((low, -1), (high, 1)):
        assert getattr(CameraConfig(**{name: value}), name) == value
        with pytest.raises(ValueError, match=words):
            CameraConfig(**{name: value + step * (1 if name.endswith("_px") else 0.001)})


def test_pose_is_that_of_the_mount_on_a_turned_robot() -> None:
    """Rotations one after the other: robot's yaw, mount's yaw, pitch down, axes of OpenCV."""
    camera = CameraConfig(
        mount_x_m=0.31, mount_y_m=-0.17, mount_height_m=0.72, mount_yaw_deg=140.0, mount_pitch_deg=23.0
    )
    yaw_rad, turned_rad, down_rad = 2.5, math.radians(140.0), math.radians(23.0)
    R_world_robot = matrix_from_axis_angle([0.0, 0.0, yaw_rad])
    R_robot_mount = matrix_from_axis_angle([0.0, 0.0, turned_rad]) @ matrix_from_axis_angle([0.0, down_rad, 0.0])
    R_mount_camera = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    T = camera.T_world_camera(-1.3, 4.1, yaw_rad, -0.2)
    np.testing.assert_allclose(T[:3, :3], R_world_robot @ R_robot_mount @ R_mount_camera, atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [-1.3, 4.1, -0.2] + R_world_robot @ [0.31, -0.17, 0.72], atol=1e-12)
    assert T[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert camera.place_m(-1.3, 4.1, yaw_rad) == pytest.approx(T[:2, 3].tolist())
    x_m, y_m, heading_rad = camera.eye(-1.3, 4.1, yaw_rad)
    assert (x_m, y_m) == pytest.approx(T[:2, 3].tolist())
    assert math.remainder(heading_rad - math.atan2(T[1, 2], T[0, 2]), math.tau) == pytest.approx(0.0, abs=1e-12)
