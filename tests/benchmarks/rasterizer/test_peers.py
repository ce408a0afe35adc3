import numpy as np
import pytest

from readygo.benchmarks.rasterizer import render
from readygo.benchmarks.rasterizer.peers import _psnr_db
from readygo.benchmarks.rasterizer.runs import make_backend
from readygo.benchmarks.rasterizer.setting import Setting


def test_slow_peer_is_left_out_of_large_scenes_and_says_so(setting: Setting) -> None:
    result = render._peers(setting, make_backend(setting), 20_000_000)
    assert "images_per_s" not in result["reference"]
    assert "Gaussians" in result["reference"]["why_none"]


def test_likeness_is_ten_times_the_logarithm_of_the_peak_over_the_error() -> None:
    image = np.full((4, 5, 3), 100, np.uint8)
    assert _psnr_db(image, image + np.uint8(255 - 100)) == pytest.approx(20 * np.log10(255 / 155))
    assert _psnr_db(image, image) > 100
    dark, light = np.zeros((2, 2, 3), np.uint8), np.full((2, 2, 3), 255, np.uint8)
    assert _psnr_db(dark, light) == pytest.approx(0.0)
