import numpy as np
import pytest

from readygo.common.images.light import LIGHT_ONE, byte_of_light, light_of_byte


def test_every_byte_comes_back_from_its_light():
    np.testing.assert_array_equal(byte_of_light()[light_of_byte()], np.arange(256))


def test_light_is_that_of_srgb():
    light = light_of_byte() / LIGHT_ONE
    assert (light[0], light[255]) == (0.0, 1.0)
    # The straight part near black, and the curve: IEC 61966-2-1.
    assert light[10] == pytest.approx(10 / 255 / 12.92, abs=1e-5)
    assert light[188] == pytest.approx(((188 / 255 + 0.055) / 1.055) ** 2.4, abs=1e-5)
