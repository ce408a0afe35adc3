import math
import struct

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.apps.drive import ros_codec as types
from readygo.apps.drive.messages import (
    Encoded,
    GoalMessage,
    OdometryMessage,
    PeopleMessage,
    ScanMessage,
    VelocityMessage,
)
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera
from readygo.common.messages.live import LivePerson

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
STAMP_NS = 1_700_000_000_123_456_789
TWIST = "00010000000000000000e03f" + 4 * "0000000000000000" + "000000000000d0bf"
"""CDR, little-endian: linear.x 0.5, angular.z -0.25."""


@pytest.fixture(scope="module")
def codec():
    return types.RosCodec()


def test_twist_has_the_bytes_that_ros_has(codec):
    sent = codec.write(types.TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=-0.25), STAMP_NS)
    assert sent.hex() == TWIST
    assert codec.read(types.TWIST_TYPE, bytes.fromhex(TWIST)) == VelocityMessage(v_mps=0.5, w_radps=-0.25)


def test_stamped_twist_begins_with_seconds_nanoseconds_and_the_frame(codec):
    sent = codec.write(types.STAMPED_TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=-0.25), STAMP_NS)
    head = "00010000" + "00f15365" + "15cd5b07" + "0a000000" + b"base_link\0".hex() + "0000"
    assert sent.hex() == head + TWIST[8:]


def test_types_have_the_published_hashes(codec):
    published = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert codec.type_hash("std_msgs/msg/String") == published
    twist = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
    assert codec.type_hash(types.TWIST_TYPE) == twist
    scan = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
    assert codec.type_hash(types.SCAN_TYPE) == scan


PERSON = LivePerson(
    number=3,
    presence=0.9,
    xy_m=(1.0, 2.0),
    v_mps=(0.5, 0.0),
    place_cov_m2=(0.01, 0.0, 0.02),
    velocity_cov_m2ps2=(0.1, 0.0, 0.2),
    age_s=0.1,
)


def test_people_are_those_of_people_msgs(codec):
    sent = codec.write(types.PEOPLE_TYPE, PeopleMessage(stamp_ns=STAMP_NS, frame="odom", people=(PERSON,)), STAMP_NS)
    head = "00010000" + "00f15365" + "15cd5b07" + "05000000" + b"odom\0".hex() + "000000" + "01000000"
    name = "02000000" + b"3\0".hex() + "0000"
    place = "000000000000f03f" + "0000000000000040" + "0000000000000000"
    velocity = "000000000000e03f" + 2 * "0000000000000000"
    assert sent.hex().startswith(head + name)
    assert place + velocity + "cdccccccccccec3f" + "03000000" in sent.hex()
    message = codec._store.deserialize_cdr(sent, types.PEOPLE_TYPE)
    (person,) = message.people
    assert (person.name, person.reliability) == ("3", 0.9)
    assert dict(zip(person.tagnames, person.tags, strict=True)) == {
        "position_covariance": "0.01 0 0.02",
        "velocity_covariance": "0.1 0 0.2",
        "age": "0.1",
    }
    assert "string[] tagnames" in codec.definition(types.PEOPLE_TYPE)
    assert codec.type_hash(types.PEOPLE_TYPE).startswith("RIHS01_")


def test_scans_are_those_of_sensor_msgs(codec):
    scan = ScanMessage(
        stamp_ns=STAMP_NS,
        frame="base_footprint",
        angle_min_rad=-0.5,
        angle_increment_rad=0.25,
        range_max_m=9.0,
        period_s=0.1,
        ranges_m=(1.0, 2.5, math.inf, math.nan),
    )
    message = codec._store.deserialize_cdr(codec.write(types.SCAN_TYPE, scan, STAMP_NS), types.SCAN_TYPE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP_NS, 10**9)
    assert message.header.frame_id == "base_footprint"
    assert (message.angle_min, message.angle_max, message.angle_increment) == (-0.5, 0.25, 0.25)
    assert (message.range_min, message.range_max, message.time_increment) == (0.0, 9.0, 0.0)
    assert message.scan_time == pytest.approx(0.1)
    np.testing.assert_array_equal(message.ranges, np.array(scan.ranges_m, np.float32))
    assert len(message.intensities) == 0


def test_odometry_keeps_the_name_of_the_robots_frame(codec):
    odometry = OdometryMessage(
        stamp_ns=7, x_m=0.0, y_m=0.0, yaw_rad=0.0, v_mps=0.0, w_radps=0.0, robot_frame="base_footprint"
    )
    assert codec.read(ODOMETRY_TYPE, codec.write(ODOMETRY_TYPE, odometry, 7)) == odometry


@pytest.mark.parametrize("kind", [types.PEOPLE_TYPE, types.SCAN_TYPE])
def test_what_is_perceived_is_not_read(codec, kind):
    with pytest.raises(ValueError, match=f"{kind} are not known"):
        codec.read(kind, b"")


@pytest.fixture(scope="module")
def ros():
    """Types and bytes of ROS 2 without the codec."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


CAMERA = LogCamera(
    height_px=4,
    width_px=6,
    K_px=(5.0, 0.25, 3.5, 0.0, 7.0, 2.5, 0.0, 0.0, 1.0),
    model="plumb_bob",
    distortion=(0.1, -0.2, 0.3, -0.4, 0.5),
    P_px=(5.0, 0.25, 3.5, 0.0, 0.0, 7.0, 2.5, 0.0, 0.0, 0.0, 1.0, 0.0),
)
ODOMETRY = OdometryMessage(stamp_ns=STAMP_NS, x_m=1.5, y_m=-2.0, yaw_rad=2.5, v_mps=0.5, w_radps=-0.1)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (types.STAMPED_TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=-0.25)),
        (types.GOAL_TYPE, GoalMessage(x_m=3.0, y_m=1.5, frame="map")),
        (types.OUTCOME_TYPE, "human_collision"),
        (INFO_TYPE, CAMERA),
    ],
)
def test_what_is_written_is_read(codec, kind, value):
    assert codec.read(kind, codec.write(kind, value, STAMP_NS)) == value


def test_odometry_has_all_that_ros_says_of_a_pose(codec, ros):
    sent = codec.write(ODOMETRY_TYPE, ODOMETRY, STAMP_NS)
    message = ros.deserialize_cdr(sent, ODOMETRY_TYPE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1.5, -2.0, 0.0)
    want = Rotation.from_euler("z", 2.5).as_quat()
    assert np.allclose((turn.x, turn.y, turn.z, turn.w), want)
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    assert (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z) == (0.5, 0.0, 0.0, 0.0, 0.0, -0.1)
    assert not np.any([message.pose.covariance, message.twist.covariance])
    found = codec.read(ODOMETRY_TYPE, sent)
    assert found.yaw_rad == pytest.approx(2.5)
    assert (found.stamp_ns, found.x_m, found.y_m, found.v_mps, found.w_radps) == (STAMP_NS, 1.5, -2.0, 0.5, -0.1)


def test_yaw_of_a_robot_that_is_tilted_is_that_of_its_forward_axis_on_the_floor(codec, ros):
    message = ros.deserialize_cdr(codec.write(ODOMETRY_TYPE, ODOMETRY, STAMP_NS), ODOMETRY_TYPE)
    turn = message.pose.pose.orientation
    angles = np.random.default_rng(3).uniform((-np.pi, -1.4, -np.pi), (np.pi, 1.4, np.pi), (40, 3))
    for yaw, pitch, roll in angles:
        rotation = Rotation.from_euler("ZYX", (yaw, pitch, roll))
        turn.x, turn.y, turn.z, turn.w = rotation.as_quat().tolist()
        forward = rotation.apply((1.0, 0.0, 0.0))
        found = codec.read(ODOMETRY_TYPE, bytes(ros.serialize_cdr(message, ODOMETRY_TYPE)))
        assert found.yaw_rad == pytest.approx(np.arctan2(forward[1], forward[0]))
        assert found.yaw_rad == pytest.approx(yaw)


def test_goals_cameras_and_images_have_all_that_ros_says_of_them(codec, ros):
    sent = codec.write(types.GOAL_TYPE, GoalMessage(x_m=3.0, y_m=1.5, frame="odom"), 5)
    goal = ros.deserialize_cdr(sent, types.GOAL_TYPE)
    turn = goal.pose.orientation
    assert (goal.header.frame_id, goal.pose.position.x, goal.pose.position.y) == ("odom", 3.0, 1.5)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    info = ros.deserialize_cdr(codec.write(INFO_TYPE, CAMERA, STAMP_NS), INFO_TYPE)
    assert (info.header.frame_id, info.height, info.width, info.distortion_model) == ("camera", 4, 6, "plumb_bob")
    assert (info.binning_x, info.binning_y, info.roi.width, info.roi.do_rectify) == (0, 0, 0, False)
    assert np.array_equal(info.r.reshape(3, 3), np.eye(3))
    assert np.array_equal(info.p.reshape(3, 4), np.column_stack([np.reshape(CAMERA.K_px, (3, 3)), np.zeros(3)]))
    image = ros.deserialize_cdr(codec.write(types.IMAGE_TYPE, np.zeros((3, 5, 3), np.uint8), 0), types.IMAGE_TYPE)
    assert (image.height, image.width, image.step, image.encoding, image.is_bigendian) == (3, 5, 15, "bgr8", 0)
    depth = ros.deserialize_cdr(codec.write(types.IMAGE_TYPE, np.ones((3, 5), np.float32), 0), types.IMAGE_TYPE)
    assert (depth.step, depth.encoding, depth.data.view("<u2").tolist()) == (10, "16UC1", [1000] * 15)


def test_big_endian_depths_of_a_robot_are_read(codec, ros):
    image = ros.deserialize_cdr(codec.write(types.IMAGE_TYPE, np.ones((3, 5), np.float32), 0), types.IMAGE_TYPE)
    image.is_bigendian, image.data = 1, image.data.view("<u2").astype(">u2").view(np.uint8)
    found = codec.read(types.IMAGE_TYPE, bytes(ros.serialize_cdr(image, types.IMAGE_TYPE)))
    assert np.array_equal(found.decode(), np.ones((3, 5), np.float32))


def test_pictures_keep_their_pixels_and_time(codec):
    bgr = np.random.default_rng(0).integers(0, 256, (8, 10, 3), np.uint8)
    raw = codec.read(types.IMAGE_TYPE, codec.write(types.IMAGE_TYPE, bgr, STAMP_NS))
    assert raw.stamp_ns == STAMP_NS
    assert np.array_equal(raw.decode(), bgr)
    flat = np.full((8, 10, 3), 90, np.uint8)
    sent = codec.write(types.COMPRESSED_TYPE, flat, STAMP_NS)
    compressed = codec.read(types.COMPRESSED_TYPE, sent)
    assert np.abs(compressed.decode().astype(int) - 90).max() <= 2
    assert (compressed.stamp_ns, compressed.encoded.format) == (STAMP_NS, "jpeg")
    assert codec.write(types.COMPRESSED_TYPE, compressed.encoded, STAMP_NS) == sent
    depth_m = np.array([[0.5, 1.25, 3.0]], np.float32)
    depths = codec.read(types.COMPRESSED_TYPE, codec.write(types.COMPRESSED_TYPE, depth_m, STAMP_NS))
    assert "compressedDepth" in depths.encoded.format
    assert np.array_equal(depths.decode(), depth_m)


def test_compressed_colour_is_blue_green_red_also_of_grey_images(codec):
    bgr = np.full((8, 8, 3), (200, 100, 20), np.uint8)
    grey = np.full((8, 8), 77, np.uint8)
    for pixels in (bgr, grey):
        file = cv2.imencode(".png", pixels)[1]
        sent = codec.write(types.COMPRESSED_TYPE, Encoded(file, "png"), 1)
        assert np.array_equal(codec.read(types.COMPRESSED_TYPE, sent).decode(), np.broadcast_to(pixels.T, (3, 8, 8)).T)
    broken = codec.write(types.COMPRESSED_TYPE, Encoded(file[:20], "png"), 1)
    with pytest.raises(ValueError, match=r"no JPEG or PNG \(format 'png'\)"):
        codec.read(types.COMPRESSED_TYPE, broken).decode()


def test_bytes_of_another_type_are_refused(codec):
    with pytest.raises(ValueError, match=r"5 bytes are no nav_msgs/msg/Odometry"):
        codec.read(ODOMETRY_TYPE, b"12345")
    with pytest.raises(ValueError, match=r"type sensor_msgs/msg/Imu are not known"):
        codec.read("sensor_msgs/msg/Imu", b"")


def test_depths_go_as_millimetres_and_come_back_in_metres(codec):
    depth_m = np.array([[0.5, np.inf, 70.0], [1.2344, 3.0, 0.0]], np.float32)
    found = codec.read(types.IMAGE_TYPE, codec.write(types.IMAGE_TYPE, depth_m, STAMP_NS))
    assert found.stamp_ns == STAMP_NS
    expected = np.array([[0.5, np.inf, np.inf], [1.234, 3.0, np.inf]], np.float32)
    assert np.array_equal(found.decode(), expected)


@pytest.mark.parametrize("number", [1e200, -1e200, float("nan"), float("inf")])
def test_odometry_with_numbers_that_no_robot_means_is_refused(codec, number):
    sent = bytearray(
        codec.write(ODOMETRY_TYPE, OdometryMessage(stamp_ns=7, x_m=0, y_m=0, yaw_rad=0, v_mps=0, w_radps=0), 7)
    )
    place = sent.index(struct.pack("<4d", 0.0, 0.0, 0.0, 1.0))
    for k in range(4):
        changed = bytearray(sent)
        changed[place + 8 * k : place + 8 * k + 8] = struct.pack("<d", number)
        with pytest.raises(ValueError, match="finite"):
            codec.read(ODOMETRY_TYPE, bytes(changed))
