import pytest

from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.image_choice import chosen_images

ROBOT = RobotConfig(cameras={"left": CameraConfig(), "small": CameraConfig(height_px=16, width_px=16)})


def test_images_are_those_of_the_cameras_the_first_one_first():
    assert chosen_images("", "", ROBOT) == ("rgb",)
    assert chosen_images("rgb, depth", "", ROBOT) == ("rgb", "depth")
    assert chosen_images("rgb,depth", "left,front", ROBOT) == ("rgb", "depth", "left.rgb", "left.depth")


@pytest.mark.parametrize(
    ("inputs", "cameras", "words"),
    [
        ("", "front,rear", "no camera 'rear'; it has front, left, small"),
        ("", "left", "must have 'front' among them"),
        ("radar", "", "images must be, camera by camera"),
        ("", "front,small", "images of one size: 'front' has 144x256 px, 'small' 16x16"),
    ],
)
def test_images_that_a_policy_cannot_see_are_refused(inputs, cameras, words):
    with pytest.raises(ConfigError, match=words):
        chosen_images(inputs, cameras, ROBOT)
