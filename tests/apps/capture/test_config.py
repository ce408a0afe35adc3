import math

import numpy as np
import pytest

from readygo.apps.capture.config import CaptureConfig, phone_camera
from readygo.common.camera.lens import make_lens
from readygo.common.errors import ConfigError


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"seconds": 1.0}, "2 s at least"),
        ({"fps": 0}, "1 to 60 frames"),
        ({"seconds": 600.0, "fps": 30}, "18000 frames are more than 3000"),
        ({"marker_size_m": -0.1}, "marker's size"),
        ({"sub_frames": 1}, "2 to 64 sub-frames"),
        ({"width_px": 641}, "even sides"),
        ({"exposure_ev": 4.0}, "drifts by 0 to 3 stops, got 4"),
        ({"equirectangular": True}, "twice as wide as high, got 640x480"),
        ({"equirectangular": True, "width_px": 960, "people": 1}, "without people and without sub-frames"),
    ],
)
def test_what_makes_no_film_is_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        CaptureConfig(**values)


def test_images_that_are_too_large_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"image size must be 8\.\.4095 px"):
        phone_camera(CaptureConfig(width_px=8000))


def test_telephone_bends_lines_a_little_and_has_a_shutter_only_if_asked() -> None:
    still, moving = phone_camera(CaptureConfig()), phone_camera(CaptureConfig(sub_frames=4))
    lens = make_lens(still)
    corner = lens.rays(np.array([[640.0, 480.0]]))[0]
    straight = (np.array([640.0, 480.0]) - still.K_px[:2, 2]) / still.K_px[0, 0]
    assert 0.001 < np.abs(corner / straight - 1.0).max() < 0.05
    assert still.exposure_s == still.readout_s == 0.0
    assert moving.exposure_s > 0.0
    assert moving.readout_s > 0.0


def test_values_at_their_limits_are_taken_and_those_beyond_refused() -> None:
    for values in ({"seconds": 2.0}, {"fps": 1}, {"fps": 60}, {"seconds": 50.0, "fps": 60}, {"marker_size_m": 0.0},
                   {"sub_frames": 2}, {"sub_frames": 64}, {"sub_frames": 0}):  # fmt: skip
        CaptureConfig(**values)
    for values in ({"seconds": 1.99}, {"fps": 61}, {"seconds": 50.02, "fps": 60}, {"sub_frames": 65},
                   {"sub_frames": -1}, {"height_px": 481}):  # fmt: skip
        with pytest.raises(ConfigError):
            CaptureConfig(**values)
    assert CaptureConfig(seconds=2.5, fps=7).frames == 18


@pytest.mark.parametrize(("width_px", "height_px"), [(640, 480), (480, 640)])
def test_telephone_looks_68_degrees_along_its_longer_side_and_is_not_centred(width_px: int, height_px: int) -> None:
    camera = phone_camera(CaptureConfig(width_px=width_px, height_px=height_px))
    assert camera.fx_px == camera.fy_px == pytest.approx(320 / math.tan(math.radians(34)))
    assert (camera.cx_px, camera.cy_px) == pytest.approx((width_px / 2 + 2.56, height_px / 2 - 1.44))
