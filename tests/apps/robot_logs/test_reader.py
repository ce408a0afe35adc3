from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.apps.robot_logs.reader import INFO_TYPE, ODOMETRY_TYPE, LogCamera, RobotLog, opened
from readygo.common.errors import ConfigError, DatasetError
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


class FakeReader:
    """A log of messages: topic, type, time, message."""

    def __init__(self, *messages: tuple[str, str, int, object]) -> None:
        self._messages = messages
        kinds = dict.fromkeys((topic, kind) for topic, kind, _, _ in messages)
        self.connections = [SimpleNamespace(topic=topic, msgtype=kind) for topic, kind in kinds]

    def messages(
        self, connections: list[SimpleNamespace], start: int = 0, stop: int = 2**62
    ) -> Iterator[tuple[SimpleNamespace, int, object]]:
        for connection in connections:
            for topic, kind, time_ns, message in self._messages:
                if (topic, kind) == (connection.topic, connection.msgtype) and start <= time_ns < stop:
                    yield connection, time_ns, message

    def deserialize(self, raw: object, kind: str) -> object:
        return raw


def log_of(*messages: tuple[str, str, int, object]) -> RobotLog:
    return RobotLog(FakeReader(*messages), Path("a.mcap"))


def placed(time_ns: int, x: float, y: float, yaw: float, tilt: tuple[float, float] = (0.0, 0.0)):
    qx, qy, qz, qw = Rotation.from_euler("ZYX", (yaw, *tilt)).as_quat().tolist()
    pose = SimpleNamespace(position=SimpleNamespace(x=x, y=y), orientation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw))
    return "/odom", ODOMETRY_TYPE, time_ns, SimpleNamespace(pose=SimpleNamespace(pose=pose))


def test_headings_are_those_of_tilted_robots_too_and_go_on_around_the_circle() -> None:
    yaws = 2.5 + 0.8 * np.arange(6)
    tilts = [(0.3, -0.4), (0.0, 0.2), (-0.7, 1.0), (0.1, 0.1), (0.0, 0.0), (0.5, -0.2)]
    messages = [placed(10 * k, 0.5 * k, -k, yaw, tilts[k]) for k, yaw in enumerate(yaws)]
    messages += [placed(50, 9.0, 9.0, 0.0), placed(40, 8.0, 8.0, 0.0)]
    found = log_of(*messages).odometry("/odom")
    assert found.time_ns.tolist() == [0, 10, 20, 30, 40, 50]
    np.testing.assert_allclose(found.xyyaw, np.stack([0.5 * np.arange(6), -np.arange(6.0), yaws], axis=1), atol=1e-9)


@pytest.mark.parametrize("messages", [[placed(0, 0.0, 0.0, 0.0)], [placed(0, 0, 0, 0), placed(1, np.nan, 0, 0)]])
def test_odometry_of_one_pose_or_without_numbers_is_refused(messages) -> None:
    with pytest.raises(DatasetError, match=r"/odom of a\.mcap has [12] poses, or some that are not finite"):
        log_of(*messages).odometry("/odom")


def test_camera_is_that_of_the_first_message() -> None:
    info = SimpleNamespace(height=3, width=5, k=range(9), distortion_model="plumb_bob", d=[0.1, -0.2])
    later = SimpleNamespace(**{**vars(info), "height": 9})
    log = log_of(("/info", INFO_TYPE, 0, info), ("/info", INFO_TYPE, 1, later), placed(0, 0, 0, 0))
    assert log.camera("/info") == LogCamera(
        height_px=3, width_px=5, K_px=tuple(map(float, range(9))), model="plumb_bob", distortion=(0.1, -0.2)
    )
    with pytest.raises(ConfigError, match=r"a\.mcap has no /odom of sensor_msgs/msg/CameraInfo; fitting topics: /info"):
        log.camera("/odom")


def test_images_within_a_time_come_with_both_its_ends() -> None:
    kind, raw_kind = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
    files = [("/image", kind, 10 * k, SimpleNamespace(data=bytes([k]))) for k in range(5)]
    log = log_of(*files)
    assert log.image_times_ns("/image").tolist() == [0, 10, 20, 30, 40]
    assert list(log.images("/image", 10, 30)) == [(10, b"\1"), (20, b"\2"), (30, b"\3")]
    rgb = np.full((3, 5, 3), (200, 100, 20), np.uint8)
    padded = np.pad(rgb.reshape(3, 15), ((0, 0), (0, 5)))
    image = {"data": padded.reshape(-1), "encoding": "rgb8", "height": 3, "width": 5, "step": 20}
    ((_, jpeg),) = log_of(("/raw", raw_kind, 7, SimpleNamespace(**image))).images("/raw", 7, 7)
    shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert np.abs(shown.astype(int) - (20, 100, 200)).max() <= 3
    odd = SimpleNamespace(**{**image, "encoding": "odd"})
    with pytest.raises(DatasetError, match="/raw has images of encoding 'odd'"):
        list(log_of(("/raw", raw_kind, 7, odd)).images("/raw", 0, 9))
