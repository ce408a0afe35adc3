import pytest

from readygo.apps.drive.named_topics import check_topics, image_topics, info_topics
from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig, RobotConfig

ROBOT = RobotConfig(cameras={"left": CameraConfig()})


def test_topics_are_named_by_the_images_on_them():
    assert image_topics((), (), ROBOT) == {"rgb": "/camera/image_raw"}
    found = image_topics(("/a", "left=/b/compressed"), ("left=/c",), ROBOT)
    assert found == {"rgb": "/a", "left.rgb": "/b/compressed", "left.depth": "/c"}
    assert image_topics(("front=/a",), (), ROBOT) == {"rgb": "/a"}
    assert image_topics((), ("left=/c",), ROBOT, every_camera=True) == {
        "rgb": "/camera/image_raw",
        "left.rgb": "/left/image_raw",
        "left.depth": "/c",
    }
    assert info_topics(image_topics(("left=/left/image_raw/compressed",), (), ROBOT)) == {
        "": "/camera/camera_info",
        "left": "/left/camera_info",
    }


@pytest.mark.parametrize(
    ("image", "depth", "words"),
    [
        (("rear=/a",), (), "--image rear=/a: there is no camera 'rear'; there are front, left"),
        (("/a", "front=/b"), (), "two topics of one camera: /a and /b"),
        (("/a", "left=/a"), (), "a different topic, got /a, /a"),
        ((), ("rear=/a",), "--depth rear=/a: there is no camera"),
        (("left=/a", "left=/b"), (), "two topics of one camera: /a and /b"),
        (("left",), (), "--image 'left' names no topic: left=/left/image_raw is one"),
        (("left=",), (), "--image 'left=' names no topic: left=/left/image_raw is one"),
        (("",), (), "--image '' names no topic: front=/front/image_raw is one"),
    ],
)
def test_topics_that_make_no_sense_are_refused(image, depth, words):
    with pytest.raises(ConfigError, match=words):
        image_topics(image, depth, ROBOT)


def test_missing_and_unwanted_topics_are_said():
    check_topics({"rgb": "/a"}, ("rgb",), ROBOT)
    with pytest.raises(
        ConfigError, match="images of the camera 'left': name the topic with --image left=/left/image_raw"
    ):
        check_topics({"rgb": "/a"}, ("rgb", "left.rgb"), ROBOT)
    with pytest.raises(ConfigError, match="does not see depths of the camera 'front': leave /d out"):
        check_topics({"rgb": "/a", "depth": "/d"}, ("rgb",), ROBOT)
    with pytest.raises(ConfigError, match="sees depths: name the topic with --depth /camera/depth/image_raw"):
        check_topics({"rgb": "/a"}, ("rgb", "depth"), RobotConfig())
