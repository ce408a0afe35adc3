import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.depth import depth_bytes, depth_rng, in_range, measured_depth, scale_depth_bytes

CAMERA = CameraConfig(depth_min_m=0.3, depth_max_m=4.0)


def ramp(shape=(200, 300)):
    return np.linspace(0.1, 6.0, shape[0] * shape[1], dtype=np.float32).reshape(shape)


def test_camera_without_errors_measures_what_is_in_its_range():
    depth_m = ramp()
    measured_m = measured_depth(depth_m, CAMERA, depth_rng("e", 0))
    inside = (depth_m >= 0.3) & (depth_m <= 4.0)
    assert np.array_equal(measured_m[inside], depth_m[inside])
    assert np.isinf(measured_m[~inside]).all()


def test_noise_grows_with_the_square_of_the_distance_and_some_pixels_are_lost():
    camera = CameraConfig(depth_max_m=10.0, depth_noise=0.004, depth_lost=0.1)
    for depth_m in (1.0, 3.0):
        measured_m = measured_depth(np.full((200, 300), depth_m, np.float32), camera, depth_rng("e", 3))
        there = np.isfinite(measured_m)
        assert 1 - there.mean() == pytest.approx(0.1, abs=0.01)
        assert np.std(measured_m[there]) == pytest.approx(0.004 * depth_m**2, rel=0.05)


def test_a_frame_is_measured_alike_whenever_it_is_and_no_two_frames_are():
    camera = CameraConfig(depth_noise=0.01)
    one, again, next_one = (measured_depth(ramp(), camera, depth_rng("e", step)) for step in (4, 4, 5))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, next_one)


def test_nothing_is_measured_where_nothing_is_and_where_no_number_is():
    depth_m = np.array([[np.inf, np.nan, 0.0, 1.0]], np.float32)
    assert np.isinf(in_range(depth_m, CAMERA)).tolist() == [[True, True, True, False]]
    assert depth_bytes(in_range(depth_m, CAMERA), CAMERA)[0, :3].tolist() == [0, 0, 0]


def test_bytes_fall_from_255_at_the_camera_to_1_at_the_end_of_the_range():
    levels = depth_bytes(np.array([0.0, 1.0, 2.0, 4.0, np.inf], np.float32), CAMERA)
    assert levels.tolist() == [255, 191, 128, 1, 0] or levels.tolist() == [255, 192, 128, 1, 0]


@pytest.mark.parametrize("wrong", [{"depth_min_m": 10.0}, {"depth_noise": -1.0}, {"depth_lost": 1.0}])
def test_depth_cameras_that_do_not_exist_are_refused(wrong):
    with pytest.raises(ValueError, match="depth_"):
        CameraConfig(**wrong)


def test_scaled_bytes_are_those_of_the_scaled_depths_and_beyond_the_range_nothing_is_measured():
    levels = np.arange(256, dtype=np.uint8)[None]
    assert np.array_equal(scale_depth_bytes(levels, np.ones((1, 256)), CAMERA), levels)
    depth_m = np.array([[0.5, 1.0, 1.9, 3.0, np.inf]], np.float32)
    doubled = scale_depth_bytes(depth_bytes(depth_m, CAMERA), np.full((1, 5), 2.0), CAMERA)
    expected = depth_bytes(np.array([[1.0, 2.0, 3.8, np.inf, np.inf]], np.float32), CAMERA)
    assert np.abs(doubled.astype(int) - expected).max() <= 1
    assert doubled[0, 3:].tolist() == [0, 0]
