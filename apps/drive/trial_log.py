"""The log of a trial, written beside the drive: what the robot sent and what it was told."""

import logging
import queue
import threading
from pathlib import Path
from typing import Any

import numpy.typing as npt

from readygo.apps.drive.messages import Encoded, Picture
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, RosCodec
from readygo.apps.drive.wires import COMPRESSED_DEPTH_SUFFIX, COMPRESSED_SUFFIX
from readygo.apps.robot_logs.pixels import is_compressed_depth
from readygo.common.dataset.ros_log import RosLogWriter

RECORD = "readygo-trial"
"""Name of what a log says of its trial."""
WAITING_MAX = 400
"""Messages that wait for the disk at most; more are left out, and counted."""

log = logging.getLogger(__name__)


class TrialLog:
    """Keeps messages as ROS has them, whatever the robot speaks. Nobody waits for it.

    Raw images of colours are compressed; what came compressed stays as it came.
    """

    def __init__(self, path: Path) -> None:
        """Begin it.

        Raises:
            ConfigError: If rosbags is not installed.
            DatasetError: If the file exists, or cannot be written.
        """
        self._codec, self._writer = RosCodec(), RosLogWriter(path)
        self._waiting: queue.Queue[tuple[str, str, Any, int] | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._work, name="trial-log", daemon=True)
        self._thread.start()
        self.left_out = 0
        """Messages that the disk was too slow for, or that it did not take."""

    def put(self, topic: str, type_name: str, value: Any, time_ns: int) -> None:
        """Keep a message.

        Args:
            topic: Where it came from.
            type_name: Its type in ROS.
            value: What it says.
            time_ns: When it came [ns since 1970].
        """
        try:
            self._waiting.put_nowait((topic, type_name, value, time_ns))
        except queue.Full:
            self.left_out += 1

    def close(self, record: dict[str, Any]) -> None:
        """Write what waits and what the trial was, and finish.

        Raises:
            OSError: If the disk does not take it.
        """
        self._waiting.put(None)
        self._thread.join()
        self._writer.add_record(RECORD, {**record, "left_out": self.left_out})
        self._writer.close()

    def abandon(self) -> None:
        """Leave no log of a trial that never began."""
        self._waiting.put(None)
        self._thread.join()
        self._writer.abandon()

    def _work(self) -> None:
        while (message := self._waiting.get()) is not None:
            try:
                self._write(*message)
            except (OSError, ValueError) as error:
                self.left_out += 1
                log.warning("%s is not in the log: %s", message[0], error)

    def _write(self, topic: str, type_name: str, value: Any, time_ns: int) -> None:
        stamp_ns = getattr(value, "stamp_ns", 0) or time_ns
        if isinstance(value, Picture):
            # To decode and encode again what came compressed would take a robot's processor more than the policy does.
            value = value.decode() if value.encoded is None else value.encoded
        if type_name == IMAGE_TYPE and (suffix := _suffix(value)):
            topic, type_name = topic.removesuffix(suffix) + suffix, COMPRESSED_TYPE
        payload = self._codec.write(type_name, value, stamp_ns)
        self._writer.add_topic(topic, type_name, self._codec.definition(type_name))
        self._writer.write(topic, payload, time_ns)


def _suffix(image: npt.NDArray[Any] | Encoded) -> str:
    """What the topic of an image ends in that is kept compressed; empty for raw depths, which stay as they are."""
    if isinstance(image, Encoded):
        return COMPRESSED_DEPTH_SUFFIX if is_compressed_depth(image.format) else COMPRESSED_SUFFIX
    return COMPRESSED_SUFFIX if image.ndim == 3 else ""
