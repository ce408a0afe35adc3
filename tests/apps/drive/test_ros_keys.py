"""The expected keys, tokens and bytes are those of rmw_zenoh's design page."""

from readygo.apps.drive import ros_keys
from readygo.apps.drive.ros_keys import Endpoint

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
LISTENER = Endpoint(kind="MS", topic="/chatter", type_name="std_msgs/msg/String", type_hash=HASH)
LISTENER_TOKEN = f"@ros2_lv/2/{SESSION}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"


def test_topics_have_the_published_keys():
    chatter = f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert ros_keys.topic_key(0, "/chatter", "std_msgs/msg/String", HASH) == chatter
    assert ros_keys.topic_key(0, "robot1/chatter", "std_msgs/msg/String", HASH) == chatter.replace("/c", "/robot1/c")
    assert ros_keys.topic_key(3, "/odom", "*", "*") == "3/odom/*/*"
    assert ros_keys.type_of_key(chatter) == "std_msgs/msg/String"


def test_nodes_and_topics_have_the_published_tokens():
    assert ros_keys.node_token(2, SESSION, "listener") == f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener"
    assert ros_keys.endpoint_token(2, SESSION, 10, "listener", LISTENER) == LISTENER_TOKEN


def test_endpoints_are_read_from_tokens_and_what_is_none_is_left_out():
    tokens = [ros_keys.node_token(2, SESSION, "listener"), LISTENER_TOKEN, "@ros2_lv/2/broken"]
    assert ros_keys.endpoints(tokens) == [LISTENER]
    deep = LISTENER_TOKEN.replace("%chatter", "%camera%image_raw").replace("/MS/", "/MP/")
    assert ros_keys.endpoints([deep])[0].topic == "/camera/image_raw"


def test_attachment_has_the_published_layout():
    sent = ros_keys.attachment(3, 1_700_000_000_123_456_789, bytes(range(16)))
    expected = "030000000000000015cd853dfe9c971710000102030405060708090a0b0c0d0e0f"
    assert sent.hex() == expected
    assert len(sent) == 33


def test_ids_of_publishers_differ_with_their_tokens():
    assert len(ros_keys.publisher_id("a")) == 16
    assert ros_keys.publisher_id("a") != ros_keys.publisher_id("b")
