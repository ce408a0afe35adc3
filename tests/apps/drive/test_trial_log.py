import numpy as np
import pytest

from readygo.apps.drive.messages import Command, Picture
from readygo.apps.drive.ros_codec import IMAGE_TYPE, TWIST_TYPE
from readygo.apps.drive.trial_log import RECORD, TrialLog
from readygo.apps.robot_logs.reader import ODOMETRY_TYPE, opened
from readygo.common.dataset.ros_log import read_record
from tests.apps.drive.conftest import T0, odometry

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")


def test_log_is_read_as_that_of_any_ros_robot(tmp_path):
    path = tmp_path / "trial.mcap"
    log = TrialLog(path)
    pixels = np.full((8, 10, 3), 90, np.uint8)
    for k in range(5):
        log.put("/odom", ODOMETRY_TYPE, odometry(T0 + k, x_m=0.1 * k), T0 + k)
        log.put("/camera/image_raw", IMAGE_TYPE, Picture(stamp_ns=T0 + k, decode=lambda: pixels), T0 + k)
        log.put("/cmd_vel", TWIST_TYPE, Command(v_mps=0.5), T0 + k)
    log.close({"ending": "goal"})
    assert read_record(path, RECORD) == {"ending": "goal", "left_out": 0}
    with opened(path) as robot_log:
        assert robot_log.odometry("/odom").xyyaw[-1].tolist() == [0.4, 0.0, 0.0]
        images = list(robot_log.images("/camera/image_raw/compressed", T0, T0 + 9))
    assert len(images) == 5
    assert images[0][1].startswith(b"\xff\xd8")


def test_message_that_cannot_be_kept_is_counted_and_hinders_nobody(tmp_path):
    def broken():
        raise ValueError("no picture")

    log = TrialLog(tmp_path / "trial.mcap")
    log.put("/camera/image_raw", IMAGE_TYPE, Picture(stamp_ns=1, decode=broken), 1)
    log.close({})
    assert read_record(tmp_path / "trial.mcap", RECORD)["left_out"] == 1


def test_log_of_a_trial_that_never_began_is_none(tmp_path):
    TrialLog(tmp_path / "trial.mcap").abandon()
    assert list(tmp_path.iterdir()) == []
