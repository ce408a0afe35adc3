"""The canonical form of an episode: what its SHA-256 covers, however a shard holds it.

In a shard an episode begins when the one before it has ended, its intrinsics are those of ROS, and there are messages
that only viewers need. None of this is the episode's own: fleets record the same episodes in other orders. In canonical
form episode `index` begins at `index * EPISODE_SLOT_NS`, pixel centres are at +0.5, and there is nothing for viewers.
A `ShardWriter` without a stage writes episodes in this form.
"""

import hashlib
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from google.protobuf.message import DecodeError
from mcap.opcode import Opcode

from readygo.common.dataset import schemas
from readygo.common.dataset.records import MESSAGE_FIELDS_SIZE, MESSAGE_HEADER, Message
from readygo.common.errors import DatasetError

EPISODE_SLOT_NS = 100 * schemas.NS_PER_S
"""Time from the beginning of an episode to that of the next index, in canonical form [ns]."""
HALF_PX = 0.5
_BY_NUMBER = {
    channel.number: channel
    for channels in (
        schemas.CHANNELS,
        schemas.OPTIONAL_CHANNELS.values(),
        (schemas.ROS_CALIBRATION,),
        *((camera.calibration, *camera.images.values()) for camera in schemas.NAMELESS_CAMERAS),
    )
    for channel in channels
}
_STAMPED = {
    number for number, channel in _BY_NUMBER.items() if channel.message.DESCRIPTOR.full_name.startswith("foxglove.")
}
_MESSAGE, _packed_head = int(Opcode.MESSAGE), MESSAGE_HEADER.pack
_VIEW_NUMBERS = {channel.number for channel in schemas.VIEW_CHANNELS}


def is_canonical(messages: Sequence[Message]) -> bool:
    """True if a shard holds an episode in canonical form."""
    return all(message.channel != schemas.ROS_CALIBRATION.number for message in messages)


def canonical_sha256(view: memoryview, messages: Sequence[Message], index: int) -> str:
    """SHA-256 of an episode: over the records of its canonical form up to its commit.

    Args:
        view: Where the messages are.
        messages: All messages of episode `index`, its commit last.
        index: Number of the episode.

    Raises:
        DatasetError: If a message cannot be read.
    """
    if is_canonical(messages):
        return hashlib.sha256(view[messages[0].offset : messages[-1].offset]).hexdigest()
    sha256 = hashlib.sha256()
    for part in canonical_parts(view, messages[:-1], index):
        sha256.update(part)
    return sha256.hexdigest()


def canonical_parts(view: memoryview, messages: Sequence[Message], index: int) -> Iterator[bytes | memoryview]:
    """The bytes of messages of episode `index` in its canonical form, piece by piece.

    Raises:
        DatasetError: If a message cannot be read.
    """
    shift_ns = index * EPISODE_SLOT_NS - messages[0].log_time_ns
    try:
        for message in messages:
            if message.channel in _VIEW_NUMBERS:
                continue
            payload = shift_times(view, message, shift_ns)
            number = message.channel
            if number == schemas.ROS_CALIBRATION.number:
                number, payload = schemas.CALIBRATION.number, with_pixels_moved(payload, HALF_PX)
            log_ns, publish_ns = message.log_time_ns + shift_ns, message.publish_time_ns + shift_ns
            yield record_head(number, message.sequence, log_ns, publish_ns, len(payload))
            yield payload
    except (DecodeError, struct.error, ValueError, OverflowError) as error:
        raise DatasetError(f"a message of an episode cannot be read: {error}") from error


def record_head(number: int, sequence: int, log_ns: int, publish_ns: int, payload_size: int) -> bytes:
    """What goes before the payload in the record of a message."""
    return _packed_head(_MESSAGE, MESSAGE_FIELDS_SIZE + payload_size, number, sequence, log_ns, publish_ns)


def shift_times(view: memoryview, message: Message, shift_ns: int) -> bytes | memoryview:
    """The payload of a message of a sample or a calibration, with the times in it moved.

    Raises:
        DecodeError: If it is no such message.
        ValueError: If a time leaves the range of its type.
    """
    payload = view[message.body : message.end]
    if shift_ns == 0 or message.channel not in _STAMPED:
        return payload

    def move(content: Any) -> None:
        for part in schemas.stamped_parts(content):
            part.timestamp.FromNanoseconds(part.timestamp.ToNanoseconds() + shift_ns)

    return _change_message(_BY_NUMBER[message.channel], payload, move)


def with_pixels_moved(calibration: bytes | memoryview, offset_px: float) -> bytes:
    """A CameraCalibration with the principal point moved by `offset_px` along both axes.

    Raises:
        DecodeError: If it is no such message.
        ValueError: If its matrices have other shapes.
    """

    def move(content: Any) -> None:
        if (len(content.K), len(content.P)) != (9, 12):
            raise ValueError("a calibration has matrices of other shapes")
        for matrix, places in ((content.K, (2, 5)), (content.P, (2, 6))):
            for place in places:
                matrix[place] += offset_px

    return _change_message(schemas.CALIBRATION, calibration, move)


def _change_message(channel: schemas.Channel, payload: bytes | memoryview, change: Callable[[Any], None]) -> bytes:
    content = channel.message.FromString(payload)
    change(content)
    return schemas.serialize(content)
