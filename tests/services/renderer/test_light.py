import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.images.light import byte_of_light, light_of_byte
from readygo.services.renderer.camera import TIME_ONE, exposure_gain, sensor_rng
from readygo.services.renderer.light import add_light, normal_of_word, to_srgb

H, W = 64, 96
KEY = (1, 2)


def camera(**light: float) -> CameraConfig:
    return CameraConfig(height_px=H, width_px=W, **light)


def developed(image: np.ndarray, taken_by: CameraConfig, step: int = 0) -> np.ndarray:
    light = np.zeros(image.shape, np.int64)
    add_light(light, image[None], None, np.full(image.shape[0], TIME_ONE, dtype=np.int64))
    return to_srgb(light, taken_by, exposure_gain(taken_by), sensor_rng(KEY, step))


def grey(byte: int) -> np.ndarray:
    return np.full((H, W, 3), byte, dtype=np.uint8)


def light_of(image: np.ndarray) -> np.ndarray:
    return light_of_byte()[image] / 65535


def test_every_byte_survives_the_way_to_light_and_back() -> None:
    every = np.arange(256, dtype=np.uint8)
    assert np.array_equal(byte_of_light()[light_of_byte()], every)
    image = np.random.default_rng(0).integers(0, 256, (H, W, 3), dtype=np.uint8)
    assert np.array_equal(developed(image, camera()), image)


def test_one_stop_doubles_the_light_and_white_balance_scales_channels() -> None:
    before, after = grey(100), developed(grey(100), camera(exposure_ev=1.0, red_gain=0.5))
    assert light_of(after)[..., 1:] == pytest.approx(2 * light_of(before)[..., 1:], rel=0.01)
    assert np.array_equal(after[..., 0], before[..., 0])
    assert (developed(grey(250), camera(exposure_ev=1.0)) == 255).all()


def test_vignetting_takes_its_share_in_the_corners_and_nothing_in_the_centre() -> None:
    gain = exposure_gain(camera(vignetting=0.4))
    assert gain[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(0.6, abs=0.02)
    assert gain[H // 2, W // 2] == pytest.approx(1.0, abs=0.001)
    assert np.allclose(gain, gain[::-1, ::-1])


@pytest.mark.parametrize("byte", [60, 128, 200])
def test_noise_has_the_variance_of_read_and_shot_noise(byte: int) -> None:
    noisy = camera(read_noise=0.01, shot_noise=0.03)
    images = [light_of(developed(grey(byte), noisy, step)) for step in range(4)]
    light = light_of(grey(byte))[0, 0, 0]
    assert np.mean(images) == pytest.approx(light, abs=3e-4)
    # Rounding to bytes adds a little.
    assert np.var(images) == pytest.approx(0.01**2 + 0.03**2 * light, rel=0.05)


def test_noise_is_independent_between_pixels_channels_and_frames() -> None:
    noisy = camera(read_noise=0.02)
    one, two = (developed(grey(128), noisy, step).astype(float) - 128 for step in (0, 1))
    scale = np.sqrt(np.mean(one * one) * np.mean(two * two))
    assert abs(np.mean(one * two)) / scale < 0.03
    assert abs(np.mean(one[:, 1:] * one[:, :-1])) / scale < 0.03
    assert abs(np.mean(one[..., 0] * one[..., 1])) / scale < 0.05


def test_noise_belongs_to_the_frame() -> None:
    noisy = camera(shot_noise=0.05)
    assert np.array_equal(developed(grey(90), noisy, 3), developed(grey(90), noisy, 3))
    assert not np.array_equal(developed(grey(90), noisy, 3), developed(grey(90), noisy, 4))


def test_table_of_deviates_is_a_standard_normal() -> None:
    table = normal_of_word().astype(np.float64)
    assert table.mean() == pytest.approx(0.0, abs=1e-9)
    assert table.var() == pytest.approx(1.0, abs=1e-3)
    assert (np.diff(table) > 0).all()


def test_light_adds_up_over_time_and_not_bytes() -> None:
    light = np.zeros((H, W, 3), np.int64)
    half = np.full(H, TIME_ONE // 2, dtype=np.int64)
    add_light(light, grey(0)[None], None, half)
    add_light(light, grey(255)[None], None, half)
    assert (to_srgb(light, camera(), np.ones((H, W)), sensor_rng(KEY, 0)) == 188).all()


def test_crooked_camera_develops_as_it_did(golden_figures) -> None:
    taken_by = camera(
        exposure_ev=0.7, red_gain=1.13, blue_gain=0.81, vignetting=0.37, shot_noise=0.02, read_noise=0.013
    )
    image = np.random.default_rng(4).integers(0, 256, (H, W, 3), dtype=np.uint8)
    golden_figures("sensor/exposure gain", exposure_gain(taken_by).reshape(-1))
    golden_figures("sensor/developed", developed(image, taken_by, step=5).reshape(-1, 3) / 64.0)
