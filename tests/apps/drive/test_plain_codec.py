import math
import time
import tracemalloc

import msgpack
import numpy as np
import pytest

from readygo.apps.drive import ros_codec as types
from readygo.apps.drive.messages import GoalMessage, OdometryMessage, PeopleMessage, ScanMessage, VelocityMessage
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera
from readygo.common.messages.live import LivePerson

CODEC = PlainCodec()


def test_commands_are_maps_with_units_in_their_names():
    sent = CODEC.write(types.TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=-0.25), 7)
    assert msgpack.unpackb(sent) == {"stamp_ns": 7, "v_mps": 0.5, "w_radps": -0.25}


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (ODOMETRY_TYPE, OdometryMessage(stamp_ns=7, x_m=1.5, y_m=-2.0, yaw_rad=2.5, v_mps=0.5, w_radps=-0.1)),
        (types.GOAL_TYPE, GoalMessage(x_m=3.0, y_m=1.5, frame="map")),
        (types.OUTCOME_TYPE, "success"),
        (types.TWIST_TYPE, VelocityMessage(v_mps=0.5, w_radps=0.1)),
        (INFO_TYPE, LogCamera(height_px=4, width_px=6, K_px=(5.0,) * 9, model="", distortion=())),
    ],
)
def test_what_is_written_is_read(kind, value):
    assert CODEC.read(kind, CODEC.write(kind, value, 7)) == value


def test_people_are_maps_in_the_frame_of_the_odometry():
    person = LivePerson(
        number=3,
        presence=0.9,
        xy_m=(1.0, 2.0),
        v_mps=(0.5, 0.0),
        place_cov_m2=(0.01, 0.0, 0.02),
        velocity_cov_m2ps2=(0.1, 0.0, 0.2),
    )
    sent = CODEC.write(types.PEOPLE_TYPE, PeopleMessage(stamp_ns=7, frame="odom_2", people=(person,)), 7)
    fields = msgpack.unpackb(sent)
    assert (fields["stamp_ns"], fields["frame"]) == (7, "odom_2")
    (told,) = fields["people"]
    assert (told["number"], told["x_m"], told["y_m"], told["vx_mps"]) == (3, 1.0, 2.0, 0.5)
    assert told["position_covariance"] == [0.01, 0.0, 0.02]
    with pytest.raises(ValueError, match="sent, not received"):
        CODEC.read(types.PEOPLE_TYPE, sent)


def test_scans_are_maps_in_the_frame_of_the_robot():
    scan = ScanMessage(
        stamp_ns=7,
        angle_min_rad=-0.5,
        angle_increment_rad=0.5,
        range_max_m=9.0,
        period_s=0.1,
        ranges_m=(1.0, 2.0, math.inf),
    )
    sent = CODEC.write(types.SCAN_TYPE, scan, 7)
    assert msgpack.unpackb(sent) == {
        "stamp_ns": 7,
        "frame": "base_link",
        "angle_min_rad": -0.5,
        "angle_increment_rad": 0.5,
        "range_max_m": 9.0,
        "period_s": 0.1,
        "ranges_m": [1.0, 2.0, math.inf],
    }
    with pytest.raises(ValueError, match="sent, not received"):
        CODEC.read(types.SCAN_TYPE, sent)


@pytest.mark.parametrize("kind", [types.IMAGE_TYPE, types.COMPRESSED_TYPE])
def test_pictures_keep_their_pixels(kind):
    bgr = np.full((8, 10, 3), (20, 90, 160), np.uint8)
    picture = CODEC.read(kind, CODEC.write(kind, bgr, 7))
    assert picture.stamp_ns == 7
    assert np.abs(picture.decode().astype(int) - bgr).max() <= 3


def test_what_is_no_message_is_refused():
    with pytest.raises(ValueError, match="no message of nav_msgs/msg/Odometry"):
        CODEC.read(ODOMETRY_TYPE, msgpack.packb({"x_m": 1.0}))
    with pytest.raises(ValueError, match="no message"):
        CODEC.read(ODOMETRY_TYPE, b"\xc1")
    broken = msgpack.packb({"encoding": "jpeg", "height_px": 4, "width_px": 4, "data": b"x"})
    with pytest.raises(ValueError, match="no jpeg"):
        CODEC.read(types.IMAGE_TYPE, broken).decode()


@pytest.mark.parametrize("kind", [ODOMETRY_TYPE, types.IMAGE_TYPE, INFO_TYPE])
def test_many_small_objects_are_refused_before_they_cost_memory(kind):
    payload = b"\x81\xa4data\xdd" + (8_000_000).to_bytes(4, "big") + b"\x90" * 8_000_000
    begin_s = time.process_time()
    tracemalloc.start()
    with pytest.raises(ValueError, match="no message"):
        CODEC.read(kind, payload)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    assert time.process_time() - begin_s < 1.0
    with pytest.raises(ValueError, match="no message"):
        CODEC.read(kind, b"\x81\xa4data" + b"\x91" * 100_000)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 1e200, -1e7])
def test_numbers_that_no_robot_means_are_refused(number):
    for name in ("x_m", "yaw_rad", "w_radps"):
        odometry = {"x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0, "v_mps": 0.0, "w_radps": 0.0} | {name: number}
        with pytest.raises(ValueError, match="it must be finite"):
            CODEC.read(ODOMETRY_TYPE, msgpack.packb(odometry))
    with pytest.raises(ValueError, match="it must be finite"):
        CODEC.read(types.TWIST_TYPE, msgpack.packb({"v_mps": number, "w_radps": 0.0}))


@pytest.mark.parametrize("stamp_ns", [-1, 2**63 - 1])
def test_times_that_are_none_are_refused(stamp_ns):
    sent = msgpack.packb({"encoding": "jpeg", "data": b"x", "stamp_ns": stamp_ns})
    with pytest.raises(ValueError, match="its time is"):
        CODEC.read(types.IMAGE_TYPE, sent)


@pytest.mark.parametrize(
    "fields", [[1, 2], {"encoding": "bgr8", "data": "text"}, {"encoding": "bgr8", "data": b"abc"}, {"encoding": "jpeg"}]
)
def test_images_of_another_shape_are_refused_as_they_come(fields):
    with pytest.raises(ValueError, match="no message"):
        CODEC.read(types.IMAGE_TYPE, msgpack.packb(fields))
    with pytest.raises(ValueError, match="no message"):
        CODEC.read(ODOMETRY_TYPE, msgpack.packb([1.0, 2.0]))
