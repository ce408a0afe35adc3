"""MCAP files of ROS 2 messages, as `ros2 bag` and Foxglove read them, with a record of what they are about."""

import json
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer

from readygo.common.documents import parse_json
from readygo.common.errors import DatasetError
from readygo.common.files import open_regular

PART_SUFFIX = ".part"


class RosLogWriter:
    """Writes one log; it has its name once it is closed, and ends in `PART_SUFFIX` before."""

    def __init__(self, path: Path) -> None:
        """Begin a log.

        Raises:
            DatasetError: If the file exists, or cannot be written.
        """
        if path.exists():
            raise DatasetError(f"{path} exists; choose another name for the log.")
        self.path, self._part = path, path.with_name(path.name + PART_SUFFIX)
        self._channels: dict[str, int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = self._part.open("wb")
        except OSError as error:
            raise DatasetError(f"{path} cannot be written: {error.strerror or error}.") from error
        # Images are encoded already; to compress them again costs time that a robot has not.
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library="readygo")

    def __enter__(self) -> "RosLogWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def add_topic(self, topic: str, type_name: str, definition: str) -> None:
        """Prepare for messages of a topic; one that is there stays.

        Args:
            topic: Its name.
            type_name: Such as nav_msgs/msg/Odometry.
            definition: Text of the type's .msg file and of those that it refers to.
        """
        if topic not in self._channels:
            schema = self._writer.register_schema(type_name, "ros2msg", definition.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)

    def write(self, topic: str, payload: bytes, time_ns: int) -> None:
        """Write a message in CDR.

        Raises:
            OSError: If the disk does not take it.
        """
        self._writer.add_message(self._channels[topic], time_ns, payload, time_ns)

    def add_record(self, name: str, record: Mapping[str, Any]) -> None:
        """Write what the log is about: plain values under a name."""
        self._writer.add_metadata(name, {key: json.dumps(value) for key, value in record.items()})

    def close(self) -> None:
        """Finish the log."""
        if not self._file.closed:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()
            self._part.rename(self.path)

    def abandon(self) -> None:
        """Leave no file."""
        self._file.close()
        self._part.unlink(missing_ok=True)


def read_record(path: Path, name: str) -> dict[str, Any]:
    """What a log is about.

    Args:
        path: The log.
        name: Name of the record.

    Raises:
        DatasetError: If this is no log, it was cut off, or it has no such record.
    """
    try:
        with open_regular(path) as file:
            # A record's stated length is not trusted: none is longer than the file.
            reader = SeekingReader(file, record_size_limit=os.fstat(file.fileno()).st_size)
            if reader.get_summary() is None:
                raise McapError("it was cut off")
            for record in reader.iter_metadata():
                if record.name == name:
                    return {key: parse_json(value) for key, value in record.metadata.items()}
    except (OSError, McapError, ValueError, LookupError, OverflowError, MemoryError, struct.error) as error:
        raise DatasetError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    raise DatasetError(f"{path} has no record {name!r}: no `readygo drive --log` wrote it.")
