import numpy as np

from readygo.apps.pictures.shades import FARTHEST_M, NEAREST_M, shaded


def test_near_depths_are_brighter_and_nothing_is_black() -> None:
    depths_m = np.array([[NEAREST_M / 2, NEAREST_M, 1.0, 3.0, FARTHEST_M, 40.0, np.inf, 0.0]], np.float32)
    picture = shaded(depths_m)
    assert (picture.shape, picture.dtype) == ((1, 8, 3), np.uint8)
    light = picture[0].astype(float).mean(axis=1)
    assert light[0] == light[1] > light[2] > light[3] > light[4] == light[5] > light[6] == light[7] == 0.0
