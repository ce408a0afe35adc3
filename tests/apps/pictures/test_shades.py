import cv2
import numpy as np

from readygo.apps.pictures.shades import FARTHEST_M, NEAREST_M, shade_depth


def test_near_depths_are_brighter_and_nothing_is_black() -> None:
    depths_m = np.array([[NEAREST_M / 2, NEAREST_M, 1.0, 3.0, FARTHEST_M, 40.0, np.inf, 0.0]], np.float32)
    picture = shade_depth(depths_m)
    assert (picture.shape, picture.dtype) == ((1, 8, 3), np.uint8)
    light = picture[0].astype(float).mean(axis=1)
    assert light[0] == light[1] > light[2] > light[3] > light[4] == light[5] > light[6] == light[7] == 0.0


def test_depths_have_the_colour_of_their_logarithm() -> None:
    places = np.array([0.0, 0.37, 0.5, 1.0])
    depths_m = np.concatenate([FARTHEST_M * (NEAREST_M / FARTHEST_M) ** places, [-1.0, np.nan]])
    colours = cv2.applyColorMap(np.rint(255 * places[:, None]).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    np.testing.assert_array_equal(shade_depth(depths_m[:, None])[:, 0], [*colours, (0, 0, 0), (0, 0, 0)])
