import struct

import numpy as np
import pytest

from readygo.apps.drive import ros_codec as types
from readygo.apps.drive.messages import Command, Goal, Odometry
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
STAMP_NS = 1_700_000_000_123_456_789
TWIST = "00010000000000000000e03f" + 4 * "0000000000000000" + "000000000000d0bf"
"""CDR, little-endian: linear.x 0.5, angular.z -0.25."""


@pytest.fixture(scope="module")
def codec():
    return types.RosCodec()


def test_twist_has_the_bytes_that_ros_has(codec):
    sent = codec.write(types.TWIST_TYPE, Command(v_mps=0.5, w_radps=-0.25), STAMP_NS)
    assert sent.hex() == TWIST
    assert codec.read(types.TWIST_TYPE, bytes.fromhex(TWIST)) == Command(v_mps=0.5, w_radps=-0.25)


def test_stamped_twist_begins_with_seconds_nanoseconds_and_the_frame(codec):
    sent = codec.write(types.STAMPED_TWIST_TYPE, Command(v_mps=0.5, w_radps=-0.25), STAMP_NS)
    head = "00010000" + "00f15365" + "15cd5b07" + "0a000000" + b"base_link\0".hex() + "0000"
    assert sent.hex() == head + TWIST[8:]


def test_types_have_the_published_hashes(codec):
    published = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert codec.type_hash("std_msgs/msg/String") == published
    twist = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
    assert codec.type_hash(types.TWIST_TYPE) == twist


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (ODOMETRY_TYPE, Odometry(stamp_ns=STAMP_NS, x_m=1.5, y_m=-2.0, yaw_rad=2.5, v_mps=0.5, w_radps=-0.1)),
        (types.GOAL_TYPE, Goal(x_m=3.0, y_m=1.5)),
        (types.OUTCOME_TYPE, "human_collision"),
        (INFO_TYPE, LogCamera(height_px=4, width_px=6, K_px=(5.0,) * 9, model="plumb_bob", distortion=(0.1,) * 5)),
    ],
)
def test_what_is_written_is_read(codec, kind, value):
    found = codec.read(kind, codec.write(kind, value, STAMP_NS))
    if isinstance(value, Odometry):
        assert found.yaw_rad == pytest.approx(value.yaw_rad)
        assert (found.stamp_ns, found.x_m, found.v_mps) == (STAMP_NS, 1.5, 0.5)
    else:
        assert found == value


def test_pictures_keep_their_pixels_and_time(codec):
    bgr = np.random.default_rng(0).integers(0, 256, (8, 10, 3), np.uint8)
    raw = codec.read(types.IMAGE_TYPE, codec.write(types.IMAGE_TYPE, bgr, STAMP_NS))
    assert raw.stamp_ns == STAMP_NS
    assert np.array_equal(raw.decode(), bgr)
    flat = np.full((8, 10, 3), 90, np.uint8)
    compressed = codec.read(types.COMPRESSED_TYPE, codec.write(types.COMPRESSED_TYPE, flat, STAMP_NS))
    assert np.abs(compressed.decode().astype(int) - 90).max() <= 2


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
    sent = bytearray(codec.write(ODOMETRY_TYPE, Odometry(stamp_ns=7, x_m=0, y_m=0, yaw_rad=0, v_mps=0, w_radps=0), 7))
    place = sent.index(struct.pack("<4d", 0.0, 0.0, 0.0, 1.0))
    for k in range(4):
        changed = bytearray(sent)
        changed[place + 8 * k : place + 8 * k + 8] = struct.pack("<d", number)
        with pytest.raises(ValueError, match="finite"):
            codec.read(ODOMETRY_TYPE, bytes(changed))
