import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.services.renderer.sensor.light import TIME_ONE
from readygo.services.renderer.sensor.shutter import make_shutter

HEIGHT = 48


def camera(**times: float) -> CameraConfig:
    return CameraConfig(height_px=HEIGHT, **times)


@pytest.mark.parametrize(
    ("exposure_s", "readout_s", "sub_frames"),
    [(0.02, 0.0, 8), (0.0, 0.02, 5), (0.01, 0.015, 7), (0.05, 0.05, 64), (1e-9, 0.02, 8), (0.004, 0.02, 4)],
)
def test_every_row_gets_all_its_light_before_the_frames_own_time(
    exposure_s: float, readout_s: float, sub_frames: int
) -> None:
    shutter = make_shutter(camera(exposure_s=exposure_s, readout_s=readout_s), sub_frames)
    assert shutter.weight.shape == (sub_frames, HEIGHT)
    assert (shutter.weight >= 0).all()
    assert (shutter.weight.sum(axis=0) == TIME_ONE).all()
    assert max(shutter.steps) < 0
    assert shutter.steps == tuple(sorted(shutter.steps))


def test_row_is_exposed_at_its_own_time_for_the_exposure() -> None:
    shutter = make_shutter(camera(exposure_s=0.01, readout_s=0.02), 64)
    times_s = np.array(shutter.steps) * 0.05
    for row in (0, 20, HEIGHT - 1):
        end_s = 0.02 * row / (HEIGHT - 1) - 0.02
        share = shutter.weight[:, row] / TIME_ONE
        assert share @ times_s == pytest.approx(end_s - 0.005, abs=2e-4)
        assert times_s[share > 0].min() >= end_s - 0.01 - 5e-4
        assert times_s[share > 0].max() <= end_s + 5e-4
        assert times_s[shutter.middle[row]] == pytest.approx(end_s - 0.005, abs=5e-4)


def test_closed_ends_need_one_image_only() -> None:
    shutter = make_shutter(camera(exposure_ev=1.0), 8)
    assert shutter.steps == (0.0,)
    assert (shutter.weight == TIME_ONE).all()


def test_without_readout_all_rows_are_alike() -> None:
    shutter = make_shutter(camera(exposure_s=0.02), 8)
    assert (shutter.weight == TIME_ONE // 8).all()


def test_shutters_are_as_they_were(golden_figures) -> None:
    for exposure_s, readout_s, sub_frames in ((0.013, 0.021, 7), (0.04, 0.0, 5), (0.0, 0.033, 9)):
        shutter = make_shutter(camera(exposure_s=exposure_s, readout_s=readout_s), sub_frames)
        golden_figures(f"sensor/shutter {sub_frames}", np.array(shutter.steps), shutter.weight / TIME_ONE)
        golden_figures(f"sensor/middles {sub_frames}", shutter.middle)
