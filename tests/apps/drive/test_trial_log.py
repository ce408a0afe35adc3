import numpy as np
import pytest
from mcap.reader import make_reader

from readygo.apps.drive.messages import ImageMessage, VelocityMessage
from readygo.apps.drive.plain_codec import PlainCodec
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, TWIST_TYPE, RosCodec
from readygo.apps.drive.trial_log import RECORD, TrialLog
from readygo.apps.robot_logs.reader import ODOMETRY_TYPE, open_log
from readygo.common.dataset.ros_log import read_record
from tests.apps.drive.conftest import T0, odometry

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")


def test_log_is_read_as_that_of_any_ros_robot(tmp_path):
    path = tmp_path / "trial.mcap"
    log = TrialLog(path)
    pixels = np.full((8, 10, 3), 90, np.uint8)
    for k in range(5):
        log.put("/odom", ODOMETRY_TYPE, odometry(T0 + k, x_m=0.1 * k), T0 + k)
        log.put("/camera/image_raw", IMAGE_TYPE, ImageMessage(stamp_ns=T0 + k, decode=lambda: pixels), T0 + k)
        log.put("/cmd_vel", TWIST_TYPE, VelocityMessage(v_mps=0.5), T0 + k)
    log.close({"ending": "goal"})
    assert read_record(path, RECORD) == {"ending": "goal", "left_out": 0}
    with open_log(path) as robot_log:
        assert robot_log.odometry("/odom").xyyaw[-1].tolist() == [0.4, 0.0, 0.0]
        images = list(robot_log.images("/camera/image_raw/compressed", T0, T0 + 9))
    assert len(images) == 5
    assert images[0][1].startswith(b"\xff\xd8")


@pytest.mark.parametrize(("codec", "type_name"), [(RosCodec(), COMPRESSED_TYPE), (PlainCodec(), IMAGE_TYPE)])
def test_what_came_compressed_is_kept_as_it_came(codec, type_name, tmp_path):
    noisy = np.random.default_rng(0).integers(0, 256, (8, 10, 3), np.uint8)
    pictures = {
        "/camera/image_raw/compressed": codec.read(type_name, codec.write(COMPRESSED_TYPE, noisy, T0)),
        "/camera/depth/compressedDepth": codec.read(
            type_name, codec.write(COMPRESSED_TYPE, np.full((8, 10), 2.0, np.float32), T0)
        ),
    }
    log = TrialLog(tmp_path / "trial.mcap")
    for topic, picture in pictures.items():
        # Keys of robots without ROS do not say what they carry.
        log.put(topic if type_name == COMPRESSED_TYPE else topic.rpartition("/")[0], type_name, picture, T0)
    log.close({})
    with (tmp_path / "trial.mcap").open("rb") as file:
        kept = {channel.topic: message.data for _, channel, message in make_reader(file).iter_messages()}
    assert set(kept) == set(pictures)
    for topic, picture in pictures.items():
        message = RosCodec().read(COMPRESSED_TYPE, kept[topic])
        assert (message.stamp_ns, message.encoded.format) == (T0, picture.encoded.format)
        assert np.array_equal(message.encoded.data, picture.encoded.data)


def test_message_that_cannot_be_kept_is_counted_and_hinders_nobody(tmp_path):
    def broken():
        raise ValueError("no picture")

    log = TrialLog(tmp_path / "trial.mcap")
    log.put("/camera/image_raw", IMAGE_TYPE, ImageMessage(stamp_ns=1, decode=broken), 1)
    log.close({})
    assert read_record(tmp_path / "trial.mcap", RECORD)["left_out"] == 1


def test_log_of_a_trial_that_never_began_is_none(tmp_path):
    TrialLog(tmp_path / "trial.mcap").abandon()
    assert list(tmp_path.iterdir()) == []
