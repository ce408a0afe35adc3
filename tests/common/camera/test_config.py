import math
from dataclasses import replace

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError

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
