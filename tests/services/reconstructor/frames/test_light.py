import numpy as np

from readygo.services.reconstructor.frames.light import encode_light, light_of


def test_encoded_values_come_back_from_light() -> None:
    every = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(encode_light(light_of(every)), every)


def test_mean_of_black_and_white_light_is_brighter_than_that_of_their_values() -> None:
    light = light_of(np.array([0, 255], np.uint8))
    assert encode_light(np.array([light.mean()]).astype(np.uint16))[0] == 188
