import msgpack
import numpy as np
import pytest

from readygo.apps.drive import ros_codec as types
from readygo.apps.drive.messages import Command, Goal, Odometry
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera

CODEC = PlainCodec()


def test_commands_are_maps_with_units_in_their_names():
    sent = CODEC.write(types.TWIST_TYPE, Command(v_mps=0.5, w_radps=-0.25), 7)
    assert msgpack.unpackb(sent) == {"stamp_ns": 7, "v_mps": 0.5, "w_radps": -0.25}


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (ODOMETRY_TYPE, Odometry(stamp_ns=7, x_m=1.5, y_m=-2.0, yaw_rad=2.5, v_mps=0.5, w_radps=-0.1)),
        (types.GOAL_TYPE, Goal(x_m=3.0, y_m=1.5)),
        (types.OUTCOME_TYPE, "success"),
        (types.TWIST_TYPE, Command(v_mps=0.5, w_radps=0.1)),
        (INFO_TYPE, LogCamera(height_px=4, width_px=6, K_px=(5.0,) * 9, model="", distortion=())),
    ],
)
def test_what_is_written_is_read(kind, value):
    assert CODEC.read(kind, CODEC.write(kind, value, 7)) == value


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
