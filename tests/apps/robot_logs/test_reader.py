import dataclasses
import os
import struct
import time
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import zstandard

from readygo.apps.robot_logs.reader import ODOMETRY_TYPE, LogCamera, RobotLog, open_log
from readygo.common.errors import DatasetError
from tests.apps.robot_logs.conftest import WriteLog

lz4 = pytest.importorskip("lz4.frame", reason="lz4 comes with rosbags and mcap")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags (extra robot-logs) is not installed")


def _record(kind: int, body: bytes) -> bytes:
    return bytes([kind]) + struct.pack("<Q", len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def log_of_one_chunk(packed: bytes, compression: str, claimed: int) -> bytes:
    """An MCAP file without a summary, as a crash leaves it, of one chunk."""
    chunk = struct.pack("<QQQI", 1, 2, claimed, 0) + _text(compression) + struct.pack("<Q", len(packed)) + packed
    magic = b"\x89MCAP0\r\n"
    return magic + _record(1, _text("ros2") + _text("x")) + _record(6, chunk) + _record(2, bytes(20)) + magic


def test_mcap_file_alone_reads_as_its_folder(write_log: WriteLog) -> None:
    folder = write_log(seconds=1.0)
    (file,) = folder.glob("*.mcap")
    for path in (folder, file):
        with open_log(path) as log:
            assert len(log.odometry("/odom").xyyaw) == 50
            assert len(log.image_times_ns("/camera/image_raw")) == 12


def test_what_is_no_log_is_said(write_log: WriteLog, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"no log")
    for name in ("a.mcap", "none"):
        with (
            pytest.raises(DatasetError, match=r"cannot be read as a ROS 2 log|does not exist"),
            open_log(tmp_path / name),
        ):
            pass


def _mcap(path: Path) -> bytes:
    return next(path.glob("*.mcap")).read_bytes()


def _refused(path: Path) -> str:
    with pytest.raises(DatasetError, match="cannot be read as a ROS 2 log") as caught, open_log(path) as log:
        (log.odometry("/odom"), log.image_times_ns("/camera/image_raw"))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed", [1_600_000_000, 4_000_000])
def test_chunk_that_unfolds_to_more_than_it_says_or_may_is_refused(
    tmp_path: Path, compression: str, claimed: int
) -> None:
    plain = bytes(64_000_000)
    packed = zstandard.compress(plain, 1) if compression == "zstd" else lz4.compress(plain)
    path = tmp_path / "a.mcap"
    path.write_bytes(log_of_one_chunk(packed, compression, claimed))
    begin_s = time.process_time()
    words = _refused(path)
    assert time.process_time() - begin_s < 2.0
    assert "is larger than the" in words if claimed > 1e9 else True


def test_damaged_logs_are_refused_in_one_line(write_log: WriteLog, tmp_path: Path) -> None:
    data = _mcap(write_log(seconds=1.0))
    path = tmp_path / "a.mcap"
    footer = len(data) - 37
    huge = (2**63).to_bytes(8, "little")
    for changed in (
        data[:8] + b"\x01" + huge + data[17:],
        data[: footer + 9] + huge + data[footer + 17 :],
        data[:30],
        data.replace(b"ros2msg", b"ros2\xff\xff\xff"),
        data.replace(b"/odom", b"/od\xff\xff"),
    ):
        path.write_bytes(changed)
        _refused(path)


def test_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap")
    _refused(tmp_path / "a.mcap")


def test_messages_that_are_compressed_one_by_one_are_read_within_the_limit(
    write_log: WriteLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_log(seconds=1.0)
    (file,) = folder.glob("*.mcap")
    notes = folder / "metadata.yaml"
    text = notes.read_text()
    assert "compression_mode: ''" in text or 'compression_mode: ""' in text
    with open_log(file) as plain:
        expected = plain.odometry("/odom").xyyaw
    reader = SimpleNamespace(
        compression_mode="message",
        storage=SimpleNamespace(metadata=_Metadata("message")),
        connections=[SimpleNamespace(topic="/odom", msgtype=ODOMETRY_TYPE)],
        messages=lambda connections: iter(packed),
    )
    with open_log(file) as log:
        connection = log._connections("/odom", (ODOMETRY_TYPE,))[0]
        packed = [(connection, t, zstandard.compress(raw)) for _, t, raw in log._reader.messages([connection])]
    log = RobotLog(reader, typesys.get_typestore(typesys.Stores.ROS2_HUMBLE), file)
    assert reader.storage.metadata.compression_mode is None
    np.testing.assert_array_equal(log.odometry("/odom").xyyaw, expected)
    monkeypatch.setattr("readygo.apps.robot_logs.reader.UNPACKED_BYTES_MAX", 100)
    with pytest.raises(DatasetError, match="unfolds to more than"):
        log.odometry("/odom")


class _Metadata(NamedTuple):
    compression_mode: str | None


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/camera/image_rect", True),
        ("/camera/image_rect_color/compressed", True),
        ("image_rect_raw", True),
        ("/camera/image_raw", False),
        ("/image_rect/image_raw", False),
        ("", False),
    ],
)
def test_images_that_ros_rectified_have_its_projection_and_no_lens(topic: str, rectified: bool) -> None:
    P = (80.0, 0.0, 30.0, -9.0, 0.0, 81.0, 20.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    raw = LogCamera(height_px=40, width_px=60, K_px=(90.0,) * 9, model="thin", distortion=(0.3,), P_px=P)
    found = raw.of_images(topic)
    if rectified:
        assert found.K_px == (80.0, 0.0, 30.0, 0.0, 81.0, 20.0, 0.0, 0.0, 1.0)
        assert (found.distortion, found.height_px, found.width_px) == ((), 40, 60)
    else:
        assert found == raw
    for unfilled in ((), (0.0,) * 12):
        unknown = dataclasses.replace(raw, P_px=unfilled)
        assert unknown.of_images(topic) == unknown
