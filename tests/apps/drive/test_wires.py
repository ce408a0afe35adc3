import pytest

from readygo.apps.drive import ros_keys
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, STAMPED_TWIST_TYPE, TWIST_TYPE
from readygo.apps.drive.ros_keys import PUBLISHER, SUBSCRIBER, Endpoint
from readygo.apps.drive.wires import RosWire, TopicWire, make_wire

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")


class FakeSession:
    """Knows the tokens of a robot's base."""

    name = "ab12"

    def __init__(self, *endpoints):
        self.tokens = [ros_keys.endpoint_token(3, "cd34", k, "base", one) for k, one in enumerate(endpoints)]
        self.announced = []

    def present(self, key):
        assert key == "@ros2_lv/3/**"
        return self.tokens

    def announce(self, key):
        self.announced.append(key)


def test_commands_have_the_type_and_the_hash_that_the_base_subscribes_to():
    wire, types = RosWire(3, "drive"), (TWIST_TYPE, STAMPED_TWIST_TYPE)
    stamped = Endpoint(
        kind=SUBSCRIBER, topic="/cmd_vel", type_name=STAMPED_TWIST_TYPE, type_hash="TypeHashNotSupported"
    )
    address = wire.address(FakeSession(stamped), "cmd_vel", types, PUBLISHER)
    assert address.type_name == STAMPED_TWIST_TYPE
    assert address.key == "3/cmd_vel/geometry_msgs::msg::dds_::TwistStamped_/TypeHashNotSupported"
    unknown = wire.address(FakeSession(), "/cmd_vel", types, PUBLISHER)
    assert unknown.key.startswith("3/cmd_vel/geometry_msgs::msg::dds_::Twist_/RIHS01_9c45bf")


def test_node_and_topic_are_announced_as_ros_does():
    wire, session = RosWire(3, "drive"), FakeSession()
    address = wire.address(session, "/cmd_vel", (TWIST_TYPE,), PUBLISHER)
    token = wire.announce(session, "/cmd_vel", address, PUBLISHER, 1)
    assert session.announced == ["@ros2_lv/3/ab12/0/0/NN/%/%/drive", token]
    assert ros_keys.endpoints([token])[0].topic == "/cmd_vel"
    assert len(wire.attachment(1, 5, token)) == 33


def test_topics_of_other_wires_are_their_keys():
    wire = TopicWire(PlainCodec(), "/robot1/", stamped=True)
    assert wire.heard_key("/camera/image_raw") == "robot1/camera/image_raw"
    assert wire.type_of("robot1/camera/image_raw/compressed", IMAGE_TYPE) == COMPRESSED_TYPE
    assert wire.type_of("robot1/camera/image_raw", IMAGE_TYPE) == IMAGE_TYPE
    assert wire.type_of("robot1/cmd_vel", TWIST_TYPE) == STAMPED_TWIST_TYPE
    assert wire.address(FakeSession(), "/odom", ("nav_msgs/msg/Odometry",), SUBSCRIBER).type_name.endswith("Odometry")


def test_wires_have_names():
    kinds = [make_wire(name, domain=0, prefix="", stamped=False, node="x") for name in ("ros2", "bridge", "plain")]
    assert [type(kind).__name__ for kind in kinds] == ["RosWire", "TopicWire", "TopicWire"]
