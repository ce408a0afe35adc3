from collections.abc import Sequence

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.lod import IMAGES_PER_RUN, _likeness, _psnr_db, _speed, _text
from readygo.benchmarks.rasterizer.setting import Setting
from readygo.common.images.images import Images
from readygo.common.rasterizer.interface import View


class Flat:
    """Draws images of one brightness after the other."""

    def __init__(self, *values: int) -> None:
        self.values, self.drawn = values, []

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        value = self.values[len(self.drawn) % len(self.values)]
        self.drawn.append(len(views))
        return Images(rgb=np.full((len(views), 2, 2, 3), value, np.uint8))


def test_likeness_is_told_of_the_worst_view_and_the_middle_one(setting: Setting) -> None:
    found = _likeness(setting, Flat(100), Flat(101, 110))
    near, far = (20 * np.log10(255 / error) for error in (1, 10))
    assert found["psnr_lowest_db"] == pytest.approx(far)
    assert found["psnr_median_db"] == pytest.approx((near + far) / 2)
    assert found["psnr_lowest_db"] < found["psnr_p5_db"] < found["psnr_median_db"]
    assert _psnr_db(np.zeros((1, 1, 3), np.uint8), np.full((1, 1, 3), 255, np.uint8)) == pytest.approx(0.0)


def test_both_draw_the_same_views_and_the_first_image_is_not_timed(setting: Setting, monkeypatch) -> None:
    clock = iter(np.arange(1000.0))
    monkeypatch.setattr("readygo.benchmarks.rasterizer.lod.time.thread_time", lambda: next(clock))
    exact, lod = Flat(0), Flat(0)
    found = _speed(setting, [exact, lod], 2, 3)
    assert exact.drawn == lod.drawn == [1, IMAGES_PER_RUN - 1] * 2 * 3
    assert found["exact_images_per_s"] == found["lod_images_per_s"] == pytest.approx(IMAGES_PER_RUN - 1)
    assert found["speed_ratio"] == 1.0


def test_numbers_have_two_places_and_words_stay() -> None:
    assert (_text(1.2345), _text(7), _text("flat")) == ("1.23", "7", "flat")
