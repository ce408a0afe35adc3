import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.policy.sight import camera_sight, channels_by_image, check_images, side_by_side

CAMERA = CameraConfig(height_px=8, width_px=10)


def test_images_lie_side_by_side_in_the_order_that_is_asked_for():
    rgb, depth = np.zeros((2, 8, 10, 3), np.uint8), np.ones((2, 8, 10), np.uint8)
    sight = side_by_side({"rgb": rgb, "depth": depth}, ("rgb", "depth"))
    assert sight.shape == (2, 8, 10, 4)
    assert np.array_equal(sight[..., 3], depth)


def test_channels_of_stacked_frames_are_found_by_image():
    assert channels_by_image(("rgb", "depth"), 2) == {"rgb": [0, 1, 2, 4, 5, 6], "depth": [3, 7]}
    assert channels_by_image(("rgb",)) == {"rgb": [0, 1, 2]}


def test_policy_that_sees_colours_alone_is_given_them_as_they_are():
    rgb = np.zeros((8, 10, 3), np.uint8)
    assert camera_sight(rgb, None, ("rgb",), CAMERA, "e", 0) is rgb


@pytest.mark.parametrize("names", [("depth",), ("rgb", "rgb"), ("rgb", "radar"), ()])
def test_images_that_no_policy_takes_are_refused(names):
    with pytest.raises(ValueError, match="images must be rgb"):
        check_images(names)
