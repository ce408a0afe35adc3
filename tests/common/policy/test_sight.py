import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.policy.sight import (
    channels_by_image,
    check_cameras,
    check_images,
    robot_sight,
    side_by_side,
)
from readygo.common.robot import RobotConfig

CAMERA = CameraConfig(height_px=8, width_px=10)
LEFT = CameraConfig(height_px=8, width_px=10, mount_yaw_deg=60.0, depth_max_m=4.0, depth_lost=0.5)
ROBOT = RobotConfig(camera=CAMERA, cameras={"left": LEFT})


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
    assert robot_sight({"rgb": rgb}, ("rgb",), ROBOT, "e", 0) is rgb


def test_each_camera_measures_depths_with_errors_of_its_own():
    drawn = {name: np.full((8, 10), 2.0, np.float32) for name in ("depth", "left.depth")}
    drawn |= {name: np.zeros((8, 10, 3), np.uint8) for name in ("rgb", "left.rgb")}
    names = ("rgb", "depth", "left.rgb", "left.depth")
    seen = robot_sight(drawn, names, ROBOT, "e", 0)
    assert seen.shape == (8, 10, 8)
    # 2 m of 10 m, and of 4 m.
    assert (seen[0, 0, 3], seen[..., 7].max()) == (204, 128)
    assert 0 < (seen[..., 7] == 0).mean() < 1


def test_cameras_that_a_robot_lacks_or_of_other_sizes_are_refused():
    check_cameras(("rgb", "left.rgb"), ROBOT)
    with pytest.raises(ValueError, match="no camera 'rear'; it has front, left"):
        check_cameras(("rgb", "rear.rgb"), ROBOT)
    other = RobotConfig(camera=CAMERA, cameras={"left": CameraConfig(height_px=16, width_px=10)})
    with pytest.raises(ValueError, match="'front' has 8x10 px, 'left' 16x10"):
        check_cameras(("rgb", "left.rgb"), other)


@pytest.mark.parametrize(
    "names",
    [("depth",), ("rgb", "rgb"), ("rgb", "radar"), (), ("rgb", "left.depth"), ("rgb", "left.rgb", "depth")],
)
def test_images_that_no_policy_takes_are_refused(names):
    with pytest.raises(ValueError, match="images must be, camera by camera, rgb"):
        check_images(names)
