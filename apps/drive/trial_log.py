"""The log of a trial, written beside the drive: what the robot sent and what it was told."""

import logging
import queue
import threading
from pathlib import Path
from typing import Any

from readygo.apps.drive.messages import Picture
from readygo.apps.drive.ros_codec import COMPRESSED_TYPE, IMAGE_TYPE, RosCodec
from readygo.apps.drive.wires import COMPRESSED_SUFFIX
from readygo.common.dataset.ros_log import RosLogWriter

RECORD = "readygo-trial"
"""Name of what a log says of its trial."""
WAITING_MAX = 400
"""Messages that wait for the disk at most; more are left out, and counted."""

log = logging.getLogger(__name__)


class TrialLog:
    """Keeps messages as ROS has them, whatever the robot speaks; raw images are compressed. Nobody waits for it."""

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
            value = value.decode()
        if type_name == IMAGE_TYPE and value.ndim == 3:
            topic, type_name = topic.removesuffix(COMPRESSED_SUFFIX) + COMPRESSED_SUFFIX, COMPRESSED_TYPE
        payload = self._codec.write(type_name, value, stamp_ns)
        self._writer.add_topic(topic, type_name, self._codec.definition(type_name))
        self._writer.write(topic, payload, time_ns)
