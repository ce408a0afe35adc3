"""Reader of ROS 2 logs: rosbag2 folders and MCAP files, read by rosbags (extra `robot-logs`).

Times are those of the recording, one clock for all topics.
"""

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.apps.robot_logs.pixels import bgr_of
from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.errors import ConfigError, DatasetError, ReadygoError
from readygo.common.extras import install_command
from readygo.common.files import open_regular

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
ODOMETRY_TYPE, INFO_TYPE = "nav_msgs/msg/Odometry", "sensor_msgs/msg/CameraInfo"
JPEG_QUALITY = 95
"""JPEG quality of raw images; compressed ones stay unchanged."""
NUMBER_MAX = 1e6
"""Largest valid number in metres, radians, pixels and their rates."""
UNPACKED_BYTES_MAX = 256 * 2**20
"""Largest unpacked size of a compressed chunk or message [bytes]; recorders write chunks of 1 to 16 MB."""
DURATION_MAX_S = 48 * 3600
_WINDOW_BYTES_MAX = 2**27
_QUATERNION_MAX = 2.0
_WORDS_MAX = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedPoses:
    """Poses of the robot over time."""

    time_ns: Int64Array
    """Times of the poses [ns], rising, shape (T,)."""
    xyyaw: Float64Array
    """Poses: x, y [m], yaw [rad, unwrapped], shape (T, 3)."""


@dataclass(frozen=True, kw_only=True)
class LogCamera:
    """The camera of a CameraInfo, pixel centres at integers."""

    height_px: int
    width_px: int
    K_px: tuple[float, ...]
    model: str
    distortion: tuple[float, ...]
    P_px: tuple[float, ...] = ()
    """Projection of the rectified images, 12 numbers; empty if unknown."""

    @classmethod
    def of(cls, info: Any) -> "LogCamera":
        """The camera of a CameraInfo."""
        return cls(
            height_px=int(info.height),
            width_px=int(info.width),
            K_px=tuple(float(value) for value in info.k),
            model=str(info.distortion_model),
            distortion=tuple(float(value) for value in info.d),
            P_px=tuple(float(value) for value in info.p),
        )

    def of_images(self, topic: str) -> "LogCamera":
        """The camera of the images on a topic: ROS calls rectified ones `image_rect...`; they have P and no lens."""
        name = topic.removesuffix("/compressed").rpartition("/")[2]
        # Some drivers leave P all zeros.
        if not name.startswith("image_rect") or len(self.P_px) != 12 or not self.P_px[0] > 0:
            return self
        return replace(self, K_px=(*self.P_px[0:3], *self.P_px[4:7], *self.P_px[8:11]), distortion=())


class RobotLog:
    """An open log, from `open_log`."""

    def __init__(self, reader: Any, types: Any, path: Path) -> None:
        self._reader, self._types, self._path = reader, types, path
        self._packed = reader.compression_mode == "message"
        if self._packed:
            # rosbags would unpack each message without a limit of its size.
            reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)

    def odometry(self, topic: str) -> LoggedPoses:
        """Read all poses; those whose time does not rise are dropped.

        Raises:
            DatasetError: If there are fewer than two poses, or one is not finite.
        """
        times: list[int] = []
        poses: list[tuple[float, float, float]] = []
        for time_ns, message in self._messages(topic, (ODOMETRY_TYPE,)):
            if not times or time_ns > times[-1]:
                times.append(time_ns)
                place = message.pose.pose.position
                poses.append((place.x, place.y, yaw_of(message.pose.pose.orientation)))
        xyyaw = np.array(poses, dtype=np.float64).reshape(-1, 3)
        # This form also rejects NaN.
        if len(xyyaw) < 2 or not (np.abs(xyyaw) <= NUMBER_MAX).all():
            raise DatasetError(
                f"{topic} of {self._path} has {len(xyyaw)} poses, or some not finite or beyond {NUMBER_MAX:g} m."
            )
        if times[-1] - times[0] > DURATION_MAX_S * 10**9 or not 0 <= times[0] <= times[-1] < 2**63:
            raise DatasetError(
                f"{topic} of {self._path} lasts longer than {DURATION_MAX_S // 3600} hours; cut it, or mend its clock."
            )
        xyyaw[:, 2] = np.unwrap(xyyaw[:, 2])
        return LoggedPoses(time_ns=np.array(times, dtype=np.int64), xyyaw=xyyaw)

    def camera(self, topic: str) -> LogCamera:
        """Read the first CameraInfo.

        Raises:
            DatasetError: If there is no CameraInfo.
        """
        for _, info in self._messages(topic, (INFO_TYPE,)):
            return LogCamera.of(info)
        raise DatasetError(f"{topic} of {self._path} has no message.")

    def image_times_ns(self, topic: str) -> Int64Array:
        """Recording times of images [ns], shape (N,); no image is decoded."""
        connections = self._connections(topic, IMAGE_TYPES)
        with _damage_in_one_line(self._path):
            return np.array([time_ns for _, time_ns, _ in self._reader.messages(connections)], dtype=np.int64)

    def images(self, topic: str, first_ns: int, last_ns: int) -> Iterator[tuple[int, bytes]]:
        """Times [ns] and encoded images from `first_ns` to `last_ns`.

        Raises:
            DatasetError: If an image has an unknown encoding.
        """
        connections = self._connections(topic, IMAGE_TYPES)
        for time_ns, message in self._read(connections, start=first_ns, stop=last_ns + 1):
            yield time_ns, _encode_image(message, topic)

    def _messages(self, topic: str, types: tuple[str, ...]) -> Iterator[tuple[int, Any]]:
        return self._read(self._connections(topic, types))

    def _read(self, connections: list[Any], **times_ns: int) -> Iterator[tuple[int, Any]]:
        with _damage_in_one_line(self._path):
            for connection, time_ns, raw in self._reader.messages(connections, **times_ns):
                data = unpack_zstd(raw, UNPACKED_BYTES_MAX) if self._packed else raw
                yield time_ns, self._types.deserialize_cdr(data, connection.msgtype)

    def _connections(self, topic: str, types: tuple[str, ...]) -> list[Any]:
        there = {each.topic: each.msgtype for each in self._reader.connections}
        found = [each for each in self._reader.connections if each.topic == topic and each.msgtype in types]
        if not found:
            fitting = [f"{name} ({kind})" for name, kind in there.items() if kind in types]
            raise ConfigError(
                f"{self._path} has no {topic} of {' or '.join(types)}; fitting topics: {', '.join(fitting) or 'none'}."
            )
        return found


@contextmanager
def open_log(path: Path) -> Iterator[RobotLog]:
    """Open a log.

    Args:
        path: A rosbag2 folder, or an MCAP file.

    Raises:
        ConfigError: If rosbags is not installed.
        DatasetError: If the path is not a log, or the log is damaged.
    """
    try:
        from rosbags.rosbag2 import Reader, storage_mcap
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ConfigError(f"Logs are read with rosbags: {install_command('robot-logs')}") from error
    if not path.exists():
        raise DatasetError(f"Log {path} does not exist.")
    storage_mcap.DECOMPRESSORS.update(zstd=unpack_zstd, lz4=_unpack_lz4)
    with ExitStack() as stack:
        with _damage_in_one_line(path):
            if not path.is_dir():
                # Opening a pipe would block.
                open_regular(path).close()
            reader = stack.enter_context(Reader(path))
            log = RobotLog(reader, get_typestore(Stores.ROS2_HUMBLE), path)
        yield log


@contextmanager
def _damage_in_one_line(path: Path) -> Iterator[None]:
    try:
        yield
    except ReadygoError:
        raise
    except Exception as error:  # rosbags and what it reads with raise what they trip over
        words = " ".join(str(error).split())[:_WORDS_MAX] or type(error).__name__
        raise DatasetError(f"{path} cannot be read as a ROS 2 log: {words}") from error


def unpack_zstd(data: bytes, size: int) -> bytes:
    """Unpack zstd data.

    Args:
        data: Frames of zstd.
        size: Largest unpacked size [bytes].

    Raises:
        ValueError: If the data unpack to more, or to more than `UNPACKED_BYTES_MAX`.
        zstandard.ZstdError: If the data are damaged.
    """
    import zstandard

    _check_size(size)
    unpacker = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES_MAX)
    unpacked: bytes = unpacker.stream_reader(data, read_across_frames=True).read(size + 1)
    if len(unpacked) > size:
        raise ValueError(f"something compressed unfolds to more than {size} bytes")
    return unpacked


def _unpack_lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    _check_size(size)
    return bytes(LZ4FrameDecompressor().decompress(data, max_length=size))


def _check_size(size: int) -> None:
    if size > UNPACKED_BYTES_MAX:
        raise ValueError(f"a chunk of {size} bytes is larger than the {UNPACKED_BYTES_MAX} that are unpacked")


def yaw_of(turn: Any) -> float:
    """Yaw of a ROS quaternion [rad]; NaN if its length is far from 1."""
    if not all(abs(number) < _QUATERNION_MAX for number in (turn.w, turn.x, turn.y, turn.z)):
        return math.nan
    return math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))


def _encode_image(message: Any, topic: str) -> bytes:
    """The JPEG or PNG of an image message."""
    if not hasattr(message, "encoding"):
        return bytes(message.data)
    try:
        bgr = bgr_of(
            message.data,
            encoding=message.encoding,
            height_px=message.height,
            width_px=message.width,
            row_bytes=message.step,
        )
    except ValueError as error:
        raise DatasetError(f"{topic} has {error}.") from error
    return bytes(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes())
