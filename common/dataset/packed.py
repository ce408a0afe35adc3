"""The messages of a sample as bytes, made without the protobuf library: a recorder makes ten of them for every sample.

The bytes are those that the library gives. A message without its time is its `content`; the time is the first field of
whatever carries one, so the same content serves at every time. Encoding: https://protobuf.dev/programming-guides/encoding.
"""

import enum
import functools
import math
import struct
from typing import NamedTuple

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from readygo.common.dataset import labels, schemas
from readygo.common.dataset.canonical import HALF_PX, with_pixels_moved
from readygo.common.images.files import FILE_FORMAT
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, kind_of
from readygo.common.messages.proto.driving_pb2 import ExpertCommands
from readygo.common.messages.proto.readygo_pb2 import StepTruth
from readygo.common.messages.proto.robot_pb2 import DrawnRobot
from readygo.common.messages.samples import EpisodeHeader, Sample

_TAGGED_DOUBLE = struct.Struct("<Bd")
_TWO_DOUBLES = struct.Struct("<BdBd")
_THREE_DOUBLES = struct.Struct("<BdBdBd")
_LENGTH = 2
"""How a field is encoded, beside its number in its tag: a length, and so many bytes."""
Upright = tuple[float, float, float, float]
"""x, y, z [m], yaw [rad] of what stands upright."""


class Timed(enum.Enum):
    """Where a message has its time."""

    NOWHERE = 0
    FIRST = -1
    """In its first field."""
    IN_TRANSFORMS = FrameTransforms.TRANSFORMS_FIELD_NUMBER
    """In the first field of every transform of a FrameTransforms."""
    IN_ENTITIES = SceneUpdate.ENTITIES_FIELD_NUMBER
    """In the first field of every entity of a SceneUpdate."""


class Content(NamedTuple):
    """A message without its time."""

    channel: schemas.Channel
    timed: Timed
    parts: tuple[bytes, ...]
    """Bytes one after the other; an image has those of its file in the second."""

    def at(self, time: bytes) -> tuple[bytes, ...]:
        """The message at a time (see `stamp`), in pieces."""
        if self.timed is Timed.FIRST:
            return (time, *self.parts)
        if self.timed is Timed.NOWHERE:
            return self.parts
        number = self.timed.value
        return tuple([field(number, time + part) for part in self.parts])


def stamp(time_ns: int) -> bytes:
    """The field with a time [ns]."""
    seconds, nanos = divmod(time_ns, schemas.NS_PER_S)
    return field(1, _number(b"\x08", seconds) + _number(b"\x10", nanos))


@functools.lru_cache(maxsize=1 << 12)
def _number(tag: bytes, value: int) -> bytes:
    """A field that is a whole number; nothing if it is zero."""
    return tag + varint(value) if value else b""


def varint(value: int) -> bytes:
    """A whole number that is not negative."""
    if value < 0x80:
        return _BYTES[value]
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def field(number: int, content: bytes) -> bytes:
    """A field below 16 that is a message or bytes."""
    return _field_head(number, len(content)) + content


@functools.lru_cache(maxsize=1 << 12)
def _field_head(number: int, size: int) -> bytes:
    return _BYTES[number << 3 | _LENGTH] + varint(size)


def doubles(*values: float) -> bytes:
    """The numbers of a message in its first fields; those that are zero are left out."""
    if len(values) == 2 and values[0] and values[1]:
        return _TWO_DOUBLES.pack(9, values[0], 17, values[1])
    out = b""
    for tag, value in zip(_DOUBLE_TAGS, values, strict=False):
        if value or math.copysign(1.0, value) < 0.0:
            out += _TAGGED_DOUBLE.pack(tag, value)
    return out


def vector(x: float, y: float, z: float) -> bytes:
    """A foxglove.Vector3."""
    return _THREE_DOUBLES.pack(9, x, 17, y, 25, z) if x and y and z else doubles(x, y, z)


def contents(sample: Sample, header: EpisodeHeader) -> list[Content]:
    """The messages of a sample, in the order of `SAMPLE_CHANNELS` and `optional_channels`."""
    found = [_image(schemas.IMAGE, sample.image, header.image_format)] if sample.image else []
    found += [
        Content(schemas.ROBOT_POSE, Timed.FIRST, (_IN_WORLD + _pose(sample.robot_xyzyaw),)),
        Content(
            schemas.HUMANS,
            Timed.FIRST,
            (_IN_WORLD + b"".join(map(_pose, sample.humans_xyzyaw)),),
        ),
        Content(schemas.ACTION, Timed.NOWHERE, (doubles(sample.action_v_mps, sample.action_w_radps),)),
        Content(schemas.GOAL, Timed.NOWHERE, (doubles(*sample.goal_xy_robot_m),)),
        Content(schemas.TRUTH, Timed.NOWHERE, (_truth(sample),)),
    ]
    images = _images(sample, header) if sample.outputs else []
    found += [image for image in images if image.channel.number < _AFTER_OUTPUTS]
    if header.labels:
        found += _labels(sample)
    if sample.expert_commands:
        found.append(_commands(sample, header))
    after = [image for image in images if image.channel.number > _AFTER_OUTPUTS]
    if header.drawn and sample.seq == 0:
        drawn = schemas.serialized(DrawnRobot(**header.drawn))
        after.append(Content(schemas.DRAWN_CHANNELS[schemas.DRAWN], Timed.NOWHERE, (drawn,)))
    return found + sorted(after, key=lambda content: content.channel.number)


def calibrations(header: EpisodeHeader) -> list[Content]:
    """The messages with the calibrations of the cameras besides the first one."""
    channels = schemas.camera_channels(camera.name for camera in header.cameras)
    found = (
        (of.calibration, schemas.calibration_message(camera, None, of.frame))
        for of, camera in zip(channels, header.cameras, strict=True)
    )
    return [Content(channel, Timed.FIRST, (with_pixels_moved(message, -HALF_PX),)) for channel, message in found]


def _images(sample: Sample, header: EpisodeHeader) -> list[Content]:
    """All images but the first camera's rgb, in the order of their channels."""
    known = _known_images(tuple(camera.name for camera in header.cameras))
    found = []
    for name, channel in schemas.output_channels(sample.outputs, known).items():
        photo = name == GOAL_IMAGE or kind_of(name) == RGB
        found.append(
            _image(channel, sample.outputs[name], header.image_format if photo else FILE_FORMAT, camera_of(name))
        )
    return found


@functools.lru_cache(maxsize=16)
def _known_images(cameras: tuple[str, ...]) -> dict[str, schemas.Channel]:
    found = schemas.optional_channels(cameras)
    return {name: channel for name, channel in found.items() if channel.number in schemas.IMAGE_NUMBERS}


def _image(channel: schemas.Channel, image: bytes, image_format: str, camera: str = "") -> Content:
    head = _field_head(2, len(image)) if image else b""
    return Content(channel, Timed.FIRST, (head, image, _image_end(image_format, camera)))


@functools.lru_cache(maxsize=32)
def _image_end(image_format: str, camera: str) -> bytes:
    frame = schemas.camera_frame(camera)
    return schemas.serialized(CompressedImage(frame_id=frame, format=image_format))


def pose(upright: Upright) -> tuple[bytes, bytes]:
    """Position and orientation of what turns about z only."""
    x_m, y_m, z_m, yaw_rad = upright
    z, w = math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad)
    turned = _TWO_DOUBLES.pack(25, z, 33, w) if z and w else doubles(0.0, 0.0, z, w)
    return vector(x_m, y_m, z_m), turned


def _pose(upright: Upright) -> bytes:
    position, orientation = pose(upright)
    # Both are shorter than 128 bytes, as is what holds them.
    return b"".join(
        (
            _POSE_HEAD[len(position) + len(orientation) + 4],
            _POSITION_HEAD[len(position)],
            position,
            _ORIENTATION_HEAD[len(orientation)],
            orientation,
        )
    )


def _truth(sample: Sample) -> bytes:
    return schemas.serialized(
        StepTruth(
            human_distance_m=sample.human_distance_m,
            time_to_collision_s=sample.time_to_collision_s,
            human_visible=sample.human_visible,
            expert_cost=sample.expert_cost,
            replanned=sample.replanned,
        )
    )


def _labels(sample: Sample) -> list[Content]:
    joints, boxes, footprints = labels.messages(
        sample.labels, None, schemas.WORLD_FRAME, floor_m=sample.robot_xyzyaw[2]
    )
    found = (
        (Timed.FIRST, (schemas.serialized(joints),)),
        (Timed.IN_ENTITIES, tuple(map(schemas.serialized, boxes.entities))),
        (Timed.FIRST, (schemas.serialized(footprints),)),
    )
    channels = schemas.LABEL_CHANNELS.values()
    return [Content(channel, *content) for channel, content in zip(channels, found, strict=True)]


def _commands(sample: Sample, header: EpisodeHeader) -> Content:
    v_mps, w_radps = zip(*sample.expert_commands, strict=True)
    message = ExpertCommands(
        v_mps=v_mps,
        w_radps=w_radps,
        risks=sample.risks,
        image_every=header.image_every if header.image_every > 1 else 0,
        outcome=header.outcome.value,
        driver=header.driver.value,
        policy=header.policy,
    )
    return Content(schemas.EXPERT_CHANNELS[schemas.EXPERT], Timed.NOWHERE, (schemas.serialized(message),))


_AFTER_OUTPUTS = next(iter(schemas.LABEL_CHANNELS.values())).number
_DOUBLE_TAGS = tuple(range(9, 48, 8))
_BYTES = tuple(bytes((value,)) for value in range(0x100))
_IN_WORLD = schemas.serialized(PoseInFrame(frame_id=schemas.WORLD_FRAME))
_POSE_HEAD, _POSITION_HEAD, _ORIENTATION_HEAD = (
    tuple(bytes((number << 3 | _LENGTH, length)) for length in range(0x80)) for number in (3, 1, 2)
)
