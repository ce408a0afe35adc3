import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import Lens, check_sensor, make_lens
from readygo.common.errors import ConfigError

CAMERA = CameraConfig()
BROWN = {"distortion": "brown_conrady", "k1": -0.05, "k2": 0.004, "k3": -0.0002, "p1": 0.002, "p2": -0.001}
FISHEYE = {"distortion": "fisheye", "k1": 0.03, "k2": -0.01, "k3": 0.002, "k4": -0.0005}


def pixel_grid(camera: CameraConfig) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    return np.stack([u, v], axis=-1).reshape(-1, 2)


def opencv_pixels(lens: Lens, xy: np.ndarray) -> np.ndarray:
    """OpenCV's projection of points on z = 1; its pixel centres are whole numbers."""
    points = np.column_stack([xy, np.ones(len(xy))])[:, None]
    K = lens.K_px - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    project = cv2.fisheye.projectPoints if lens.fisheye else cv2.projectPoints
    pixels, _ = project(points, np.zeros(3), np.zeros(3), K, np.array(lens.coefficients))
    return pixels[:, 0] + 0.5


@pytest.mark.parametrize(
    ("optics", "intrinsics"),
    [
        (BROWN, {"horizontal_fov_deg": 60.0}),
        (BROWN, {"horizontal_fov_deg": 100.0}),
        (FISHEYE, {"horizontal_fov_deg": 100.0}),
        (FISHEYE, {"horizontal_fov_deg": 125.0}),
        ({"distortion": "fisheye"}, {"horizontal_fov_deg": 125.0}),
        (BROWN, {"fx_px": 120.0, "fy_px": 118.0, "cx_px": 131.0, "cy_px": 70.5}),
        (FISHEYE, {"fx_px": 110.0, "fy_px": 114.0, "cx_px": 125.0, "cy_px": 75.0}),
    ],
)
def test_rays_of_all_pixels_project_back_with_opencv(optics, intrinsics) -> None:
    camera = CameraConfig(**optics, **intrinsics)
    lens, uv = make_lens(camera), pixel_grid(camera)
    rays = lens.rays(uv)
    assert np.abs(opencv_pixels(lens, rays) - uv).max() < 0.001
    assert np.abs(lens.pixels(rays) - uv).max() < 1e-6


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.15, 0.3), st.floats(-0.02, 0.05), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_lens_is_either_refused_or_inverts_exactly(k1: float, k2: float, p1: float, p2: float) -> None:
    try:
        lens = make_lens(CameraConfig(distortion="brown_conrady", k1=k1, k2=k2, p1=p1, p2=p2))
    except ConfigError:
        return
    uv = pixel_grid(CAMERA)[::37]
    assert np.abs(lens.pixels(lens.rays(uv)) - uv).max() < 1e-6


@pytest.mark.parametrize("optics", [{"distortion": "brown_conrady", "k1": -0.05}, FISHEYE])
def test_image_spans_the_cameras_field_of_view(optics) -> None:
    lens = make_lens(CameraConfig(**optics))
    left, right = lens.rays(np.array([[0.0, CAMERA.height_px / 2], [CAMERA.width_px, CAMERA.height_px / 2]]))
    angle_rad = math.atan(right[0]) - math.atan(left[0])
    assert math.degrees(angle_rad) == pytest.approx(CAMERA.horizontal_fov_deg, abs=1e-9)


def test_lens_without_distortion_keeps_the_intrinsics() -> None:
    for camera in (CAMERA, CameraConfig(distortion="brown_conrady")):
        assert np.array_equal(make_lens(camera).K_px, CAMERA.K_px)


@pytest.mark.parametrize(
    ("optics", "sensor"),
    [
        ({"distortion": "brown_conrady", "k1": -0.3}, SensorConfig()),
        ({"distortion": "brown_conrady", "k1": -0.2}, SensorConfig()),
        ({"distortion": "brown_conrady", "p1": 0.5}, SensorConfig()),
        ({"distortion": "fisheye", "k1": -0.6}, SensorConfig()),
        ({"distortion": "brown_conrady"}, SensorConfig(k1=(-0.3, 0.0))),
        ({**BROWN, "k1": -0.3, "fx_px": 60.0, "fy_px": 60.0, "cx_px": 128.0, "cy_px": 72.0}, SensorConfig()),
    ],
)
def test_distortion_that_folds_the_image_is_refused(optics, sensor: SensorConfig) -> None:
    with pytest.raises(ConfigError, match=r"brown_conrady|fisheye") as caught:
        check_sensor(sensor, CameraConfig(**optics))
    assert "folds the image" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_more_than_a_half_space_is_refused() -> None:
    make_lens(CameraConfig(distortion="fisheye", horizontal_fov_deg=150.0))
    with pytest.raises(ConfigError, match="176 deg"):
        make_lens(CameraConfig(distortion="fisheye", horizontal_fov_deg=165.0))


def test_range_of_a_coefficient_that_the_lens_does_not_have_is_refused() -> None:
    with pytest.raises(ConfigError, match=r'renderer\.sensor\.k1 has no meaning with distortion "none"'):
        check_sensor(SensorConfig(k1=(-0.1, 0.1)), CAMERA)
    with pytest.raises(ConfigError, match="k4 has no meaning"):
        check_sensor(SensorConfig(k4=(0.0, 0.1)), CameraConfig(**BROWN))


def test_what_the_lens_cannot_show_is_beyond_its_largest_radius() -> None:
    for optics in (BROWN, FISHEYE):
        lens = make_lens(CameraConfig(**optics))
        assert np.hypot(*lens.rays(pixel_grid(CAMERA)).T).max() < lens.radius_max
