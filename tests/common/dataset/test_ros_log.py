import os

import pytest

from readygo.common.dataset.ros_log import PART_SUFFIX, RosLogWriter, read_record
from readygo.common.errors import DatasetError


def test_log_has_its_name_when_it_is_whole_and_says_what_it_is_about(tmp_path):
    path = tmp_path / "new" / "trial.mcap"
    with RosLogWriter(path) as log:
        assert not path.exists()
        log.add_topic("/chatter", "std_msgs/msg/String", "string data")
        log.write("/chatter", b"\0\1\0\0\2\0\0\0a\0", 5)
        log.add_record("trial", {"ending": "goal", "numbers": {"a": 1.5}})
    assert read_record(path, "trial") == {"ending": "goal", "numbers": {"a": 1.5}}
    assert not list(path.parent.glob(f"*{PART_SUFFIX}"))
    with pytest.raises(DatasetError, match="has no record 'other'"):
        read_record(path, "other")
    with pytest.raises(DatasetError, match="exists; choose another name"):
        RosLogWriter(path)


def test_log_that_is_given_up_leaves_nothing(tmp_path):
    log = RosLogWriter(tmp_path / "trial.mcap")
    log.abandon()
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_log_is_refused(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"nothing")
    with pytest.raises(DatasetError, match=r"x\.mcap cannot be read"):
        read_record(tmp_path / "x.mcap", "trial")
    with pytest.raises(DatasetError, match="No such file"):
        read_record(tmp_path / "none.mcap", "trial")


def test_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(DatasetError, match=r"a\.mcap cannot be read: it is a pipe or a device"):
        read_record(tmp_path / "a.mcap", "x")


def test_log_costs_no_more_than_its_bytes(tmp_path):
    with RosLogWriter(tmp_path / "a.mcap") as log:
        log.add_record("trial", {"a": 1})
    data = (tmp_path / "a.mcap").read_bytes()
    footer = len(data) - 37
    huge = (2**62).to_bytes(8, "little")
    for changed in (
        data[: footer + 9] + huge + data[footer + 17 :],
        data[: footer + 9] + bytes(8) + data[footer + 17 :],
        data.replace(b"trial", b"tri\xff\xff"),
    ):
        (tmp_path / "b.mcap").write_bytes(changed)
        with pytest.raises(DatasetError):
            read_record(tmp_path / "b.mcap", "trial")
