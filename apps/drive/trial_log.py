"""The log of a trial, written by a separate thread: the robot's messages and its commands."""

import logging
import queue
import threading
from pathlib import Path
from typing import Any

from readygo.apps.drive.messages import Encoded, ImageMessage
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, RosCodec
from readygo.apps.drive.wires import COMPRESSED_DEPTH_SUFFIX, COMPRESSED_SUFFIX
from readygo.apps.robot_logs.pixels import is_compressed_depth
from readygo.common.arrays import AnyArray
from readygo.common.dataset.ros_log import RosLogWriter

RECORD = "readygo-trial"
"""Name of the MCAP metadata record with the trial's result."""
WAITING_MAX = 400
"""Largest number of messages that wait for the disk; further ones are dropped and counted."""

log = logging.getLogger(__name__)


class TrialLog:
    """MCAP log with ROS messages, for robots of any transport. Writing never blocks the drive.

    Raw colour images are compressed; compressed images are stored as received.
    """

    def __init__(self, path: Path) -> None:
        """Open the log.

        Raises:
            ConfigError: If rosbags is not installed.
            DatasetError: If the file exists, or cannot be written.
        """
        self._codec, self._writer = RosCodec(), RosLogWriter(path)
        self._waiting: queue.Queue[tuple[str, str, Any, int] | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._work, name="trial-log", daemon=True)
        self._thread.start()
        self.left_out = 0
        """Number of messages that were not written, because the disk was too slow or failed."""

    def put(self, topic: str, type_name: str, value: Any, time_ns: int) -> None:
        """Queue a message for the log.

        Args:
            topic: Topic of the message.
            type_name: Its type in ROS.
            value: Its content.
            time_ns: Time of its arrival or sending [ns since 1970].
        """
        try:
            self._waiting.put_nowait((topic, type_name, value, time_ns))
        except queue.Full:
            self.left_out += 1

    def close(self, record: dict[str, Any]) -> None:
        """Write the waiting messages and the trial's result, and close the file.

        Raises:
            OSError: If the disk cannot be written.
        """
        self._waiting.put(None)
        self._thread.join()
        self._writer.add_record(RECORD, {**record, "left_out": self.left_out})
        self._writer.close()

    def abandon(self) -> None:
        """Remove the log of a trial that never began."""
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
        if isinstance(value, ImageMessage):
            # Decoding and encoding compressed images again would cost a robot's processor more than the policy does.
            value = value.decode() if value.encoded is None else value.encoded
        if type_name == IMAGE_TYPE and (suffix := _suffix(value)):
            topic, type_name = topic.removesuffix(suffix) + suffix, COMPRESSED_TYPE
        payload = self._codec.write(type_name, value, stamp_ns)
        self._writer.add_topic(topic, type_name, self._codec.definition(type_name))
        self._writer.write(topic, payload, time_ns)


def _suffix(image: AnyArray | Encoded) -> str:
    """Suffix of the topic of an image that is stored compressed; empty for raw depths, which stay raw."""
    if isinstance(image, Encoded):
        return COMPRESSED_DEPTH_SUFFIX if is_compressed_depth(image.format) else COMPRESSED_SUFFIX
    return COMPRESSED_SUFFIX if image.ndim == 3 else ""
