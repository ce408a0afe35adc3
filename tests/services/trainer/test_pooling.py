import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.services.trainer.pooling import pool, pooling_of, thin_pixels


def test_pooling_leaves_the_height_and_divides_the_image():
    sizes = [(72, 128), (144, 256), (240, 320), (216, 384), (100, 101), (36, 64)]
    factors = [pooling_of(CameraConfig(height_px=h, width_px=w), 72) for h, w in sizes]
    assert factors == [1, 2, 2, 3, 1, 1]
    assert pooling_of(CameraConfig(), 0) == 1


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_pooled_pixel_is_the_mean_with_halves_rounded_up(factor):
    frame = np.random.default_rng(0).integers(0, 256, (24, 48, 3), np.uint8)
    means = frame.reshape(24 // factor, factor, 48 // factor, factor, 3).astype(np.float64).mean(axis=(1, 3))
    assert np.array_equal(pool(frame, factor), np.floor(means + 0.5))


def test_thinned_pixels_are_those_in_the_middle():
    depth = np.arange(36, dtype=np.uint8).reshape(6, 6)
    assert thin_pixels(depth, 3).tolist() == [[7, 10], [25, 28]]
