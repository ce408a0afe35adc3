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


def test_tables_are_straight_lines_of_a_contrast_a_brightness_and_three_colours():
    light = draw_light(3000, 0.3, np.random.default_rng(1)).astype(np.float64)
    slopes = (light[:, 255] - light[:, 0]) / 2
    # A byte of 127.5 is the middle of the scale.
    middles = (light[:, 255] + light[:, 0]) / 2
    np.testing.assert_allclose(light[:, 51], middles + slopes * (51 / 127.5 - 1), atol=1e-5)
    # slope = contrast * colour, middle = brightness + colour - 1
    apart = np.abs(middles[:, 0] - middles[:, 1]) > 0.02
    contrast = ((slopes[:, 0] - slopes[:, 1]) / (middles[:, 0] - middles[:, 1]))[apart]
    colours = slopes[apart] / contrast[:, None] - 1
    brightness = middles[apart] - colours
    np.testing.assert_allclose(brightness, np.broadcast_to(brightness[:, :1], brightness.shape), atol=1e-4)
    for values, most in ((contrast - 1, 0.3), (colours[:, 2], 0.15), (brightness[:, 0], 0.3)):
        assert -most - 1e-4 < values.min() < -0.95 * most
        assert 0.95 * most < values.max() < most + 1e-4
        assert abs(values.mean()) < 0.1 * most
    assert abs(np.corrcoef(contrast, brightness[:, 0])[0, 1]) < 0.1
    assert abs(np.corrcoef(colours[:, 0], colours[:, 2])[0, 1]) < 0.1
