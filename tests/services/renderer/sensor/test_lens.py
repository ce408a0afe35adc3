import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig
from readygo.services.renderer.sensor.config import SensorConfig, SensorRanges, sensor_phone_like
from readygo.services.renderer.sensor.lens import Lens, check_sensor, make_lens

CAMERA = CameraConfig()
BROWN = SensorConfig(distortion="brown_conrady", k1=-0.05, k2=0.004, k3=-0.0002, p1=0.002, p2=-0.001)
FISHEYE = SensorConfig(distortion="fisheye", k1=0.03, k2=-0.01, k3=0.002, k4=-0.0005)


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
    ("sensor", "fov_deg"),
    [(BROWN, 60.0), (BROWN, 100.0), (FISHEYE, 100.0), (FISHEYE, 125.0), (SensorConfig(distortion="fisheye"), 125.0)],
)
def test_rays_of_all_pixels_project_back_with_opencv(sensor: SensorConfig, fov_deg: float) -> None:
    camera = CameraConfig(horizontal_fov_deg=fov_deg)
    lens, uv = make_lens(sensor, camera), pixel_grid(camera)
    rays = lens.rays(uv)
    assert np.abs(opencv_pixels(lens, rays) - uv).max() < 0.001
    assert np.abs(lens.pixels(rays) - uv).max() < 1e-6


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.15, 0.3), st.floats(-0.02, 0.05), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_lens_is_either_refused_or_inverts_exactly(k1: float, k2: float, p1: float, p2: float) -> None:
    sensor = SensorConfig(distortion="brown_conrady", k1=k1, k2=k2, p1=p1, p2=p2)
    try:
        lens = make_lens(sensor, CAMERA)
    except ConfigError:
        return
    uv = pixel_grid(CAMERA)[::37]
    assert np.abs(lens.pixels(lens.rays(uv)) - uv).max() < 1e-6


@pytest.mark.parametrize("sensor", [BROWN, FISHEYE])
def test_image_spans_the_robots_field_of_view(sensor: SensorConfig) -> None:
    lens = make_lens(sensor if sensor is FISHEYE else SensorConfig(distortion="brown_conrady", k1=-0.05), CAMERA)
    left, right = lens.rays(np.array([[0.0, CAMERA.height_px / 2], [CAMERA.width_px, CAMERA.height_px / 2]]))
    angle_rad = math.atan(right[0]) - math.atan(left[0])
    assert math.degrees(angle_rad) == pytest.approx(CAMERA.horizontal_fov_deg, abs=1e-9)


def test_lens_without_distortion_keeps_the_intrinsics() -> None:
    for sensor in (SensorConfig(), SensorConfig(distortion="brown_conrady")):
        assert np.allclose(make_lens(sensor, CAMERA).K_px, CAMERA.K_px, rtol=1e-15, atol=0)


@pytest.mark.parametrize(
    "sensor",
    [
        SensorConfig(distortion="brown_conrady", k1=-0.3),
        SensorConfig(distortion="brown_conrady", k1=-0.2),
        SensorConfig(distortion="brown_conrady", p1=0.5),
        SensorConfig(distortion="fisheye", k1=-0.6),
        SensorConfig(distortion="brown_conrady", ranges=SensorRanges(k1=(-0.3, 0.0))),
    ],
)
def test_distortion_that_folds_the_image_is_refused(sensor: SensorConfig) -> None:
    with pytest.raises(ConfigError, match=r"brown_conrady|fisheye") as caught:
        check_sensor(sensor, CAMERA)
    assert "folds the image" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_more_than_a_half_space_is_refused() -> None:
    check_sensor(SensorConfig(distortion="fisheye"), CameraConfig(horizontal_fov_deg=150.0))
    with pytest.raises(ConfigError, match="176 deg"):
        check_sensor(SensorConfig(distortion="fisheye"), CameraConfig(horizontal_fov_deg=165.0))


def test_recipe_suits_the_default_camera() -> None:
    check_sensor(sensor_phone_like(), CAMERA)
