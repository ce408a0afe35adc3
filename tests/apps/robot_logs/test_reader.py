from pathlib import Path

import pytest

from readygo.apps.robot_logs.reader import opened
from readygo.common.errors import DatasetError
from tests.apps.robot_logs.conftest import WriteLog


def test_mcap_file_alone_reads_as_its_folder(write_log: WriteLog) -> None:
    folder = write_log(seconds=1.0)
    (file,) = folder.glob("*.mcap")
    for path in (folder, file):
        with opened(path) as log:
            assert len(log.odometry("/odom").xyyaw) == 50
            assert len(log.image_times_ns("/camera/image_raw")) == 12


def test_what_is_no_log_is_said(write_log: WriteLog, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"no log")
    for name in ("a.mcap", "none"):
        with (
            pytest.raises(DatasetError, match=r"cannot be read as a ROS 2 log|does not exist"),
            opened(tmp_path / name),
        ):
            pass
