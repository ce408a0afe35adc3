import numpy as np

from readygo.services.trainer.light import draw_light, light_on, lit
from readygo.services.trainer.views import plain_view


def test_light_varies_between_groups_and_none_keeps_the_image():
    light = draw_light(2, 0.3, np.random.default_rng(0))
    frames = np.full((3, 2, 2, 3), 160, np.uint8)
    shown = lit(frames, np.array([0, 1, 0]), light)
    assert np.array_equal(shown[0], shown[2])
    assert not np.array_equal(shown[0], shown[1])
    plain = lit(
        np.array([0, 255], np.uint8).reshape(1, 2, 1, 1).repeat(3, axis=3), np.zeros(1, int), plain_view().light
    )
    assert plain[0, :, 0].tolist() == [[-1.0] * 3, [1.0] * 3]


def test_tables_of_sixteen_bits_stay_so():
    light = np.arange(256 * 3, dtype=np.int16).reshape(1, 256, 3)
    shown = lit(np.full((1, 1, 1, 3), 7, np.uint8), np.zeros(1, np.int64), light)
    assert shown.dtype == np.int16
    assert shown.ravel().tolist() == [21, 22, 23]


def test_light_falls_on_colours_of_all_cameras_alone():
    light = draw_light(2, 0.3, np.random.default_rng(0))
    tables = light_on(light, ("rgb", "depth", "left.rgb"))
    assert np.array_equal(tables[..., 4:], light)
    assert np.allclose(tables[..., 3], np.arange(256) / 127.5 - 1)
