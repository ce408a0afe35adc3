"""The messages of samples as bytes, made without the protobuf library, those of an episode's samples at once.

The bytes are those that the library gives. Messages without their times are `Messages`; the time is the first field of
each message that carries one, so the same content serves at every time.
"""

import enum
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from readygo.common.arrays import BoolArray, Float64Array, RecordArray
from readygo.common.dataset import columns, labels, schemas
from readygo.common.dataset.canonical import HALF_PX, with_pixels_moved
from readygo.common.dataset.columns import Column, Part, Pieces
from readygo.common.images.files import FILE_FORMAT
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, kind_of
from readygo.common.messages.proto.driving_pb2 import ExpertCommands
from readygo.common.messages.proto.robot_pb2 import DrawnRobot
from readygo.common.messages.samples import EpisodeHeader, Sample

NUMBERS_DTYPE = np.dtype(
    [
        ("action", "<f8", (2,)),
        ("goal_xy_m", "<f8", (2,)),
        ("pose", "<f8", (4,)),
        ("human_distance_m", "<f8"),
        ("time_to_collision_s", "<f8"),
        ("expert_cost", "<f8"),
        ("human_visible", "<f8"),
        ("replanned", "<f8"),
    ]
)
"""The numbers of a sample, see `SAMPLE_DTYPE`; the yaw as it was sent."""
Upright = tuple[float, float, float, float]
"""x, y, z [m], yaw [rad] of what stands upright."""


class Timed(enum.Enum):
    """Where a message has its time."""

    NOWHERE = 0
    FIRST = -1
    """The time is the first field of the message."""
    IN_TRANSFORMS = FrameTransforms.TRANSFORMS_FIELD_NUMBER
    """The time is the first field of every transform of a FrameTransforms."""
    IN_ENTITIES = SceneUpdate.ENTITIES_FIELD_NUMBER
    """The time is the first field of every entity of a SceneUpdate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Messages:
    """The messages of N samples on a channel, without their times."""

    channel: schemas.Channel
    timed: Timed
    groups: Sequence[Sequence[Part]]
    """One, or with times inside one for each transform or entity, which is not there where it has no bytes; an image
    has those of its file in the second part."""
    there: BoolArray | None = None
    """True for samples that have a message on this channel, shape (N,); None if all have."""

    def at(self, stamps: Column) -> list[Part]:
        """The messages at their times (see `columns.stamps`)."""
        if self.timed is Timed.NOWHERE:
            parts = list(self.groups[0])
        elif self.timed is Timed.FIRST:
            parts = [stamps, *self.groups[0]]
        else:
            parts = [part for group in self.groups for part in _within(self.timed.value, stamps, group)]
        return [part.where(self.there) for part in parts]


def _within(number: int, stamps: Column, group: Sequence[Part]) -> list[Part]:
    """A field with a time and more; nothing where there is no more."""
    there = columns.sizes_of(group) > 0
    head = columns.field_head(number, stamps, *group)
    return [head.where(there), stamps.where(there), *group]


def stamp(time_ns: int) -> bytes:
    """The field with a time [ns]."""
    return columns.rows_of([columns.stamps(np.array([time_ns], dtype=np.uint64))])[0]


def numbers_of(samples: Sequence[Sample]) -> RecordArray:
    """Rows of `NUMBERS_DTYPE`, one per sample."""
    rows = [
        (
            sample.action_v_mps,
            sample.action_w_radps,
            *sample.goal_xy_robot_m,
            *sample.robot_xyzyaw,
            sample.human_distance_m,
            sample.time_to_collision_s,
            sample.expert_cost,
            sample.human_visible,
            sample.replanned,
        )
        for sample in samples
    ]
    return np.array(rows, dtype=np.float64).view(NUMBERS_DTYPE)[:, 0]


def messages(samples: Sequence[Sample], header: EpisodeHeader, numbers: RecordArray | None = None) -> list[Messages]:
    """The messages of samples, in the order of `SAMPLE_CHANNELS` and `optional_channels`.

    Args:
        samples: All with the same outputs, but for those without images and the image of the goal.
        header: Header of their episode.
        numbers: The samples' numbers, from `numbers_of`; computed by default.
    """
    numbers = numbers_of(samples) if numbers is None else numbers
    files, outputs = [sample.image for sample in samples], _outputs(samples, header)
    found = [_image(schemas.IMAGE, files, files, header.image_format)] if any(files) else []
    found += _dense(samples, numbers)
    found += [output for output in outputs if output.channel.number < _AFTER_OUTPUTS]
    if header.labels:
        found += _labels(samples)
    if any(sample.expert_commands for sample in samples):
        found.append(_commands(samples, header))
    after = [output for output in outputs if output.channel.number > _AFTER_OUTPUTS]
    if header.drawn and samples[0].seq == 0:
        after.append(_drawn_messages(samples, header))
    return found + sorted(after, key=lambda messages: messages.channel.number)


def calibrations(header: EpisodeHeader) -> list[tuple[schemas.Channel, bytes]]:
    """The messages with the calibrations of the cameras besides the first one; their times (see `stamp`) go before."""
    channels = schemas.camera_channels(camera.name for camera in header.cameras)
    found = (
        (of.calibration, schemas.calibration_message(camera, None, of.frame))
        for of, camera in zip(channels, header.cameras, strict=True)
    )
    return [(channel, with_pixels_moved(message, -HALF_PX)) for channel, message in found]


def people(rows: Sequence[Sequence[Upright]]) -> tuple[Float64Array, BoolArray]:
    """The humans of N samples, shape (N, H, 4), and which of them are there, shape (N, H)."""
    counts = np.array([len(row) for row in rows])
    most = int(counts.max())
    there = np.arange(most) < counts[:, None]
    if not there.all():
        nobody = ((0.0, 0.0, 0.0, 0.0),) * most
        rows = [(*row, *nobody[len(row) :]) for row in rows]
    return np.array(rows, dtype=np.float64).reshape(len(rows), most, 4), there


def pose(xyzyaw: Float64Array) -> tuple[Column, Column]:
    """Positions and orientations of what turns about z only.

    Args:
        xyzyaw: x, y, z [m], yaw [rad], shape (N, 4).
    """
    # Not numpy's, which differ from machine to machine.
    halves = (0.5 * xyzyaw[:, 3]).tolist()
    z, w = (np.array(list(map(function, halves)), dtype=np.float64) for function in (math.sin, math.cos))
    return columns.doubles(1, *xyzyaw[:, :3].T), columns.doubles(3, z, w)


def _poses(number: int, xyzyaw: Float64Array) -> Column:
    """A field with a foxglove.Pose."""
    position, orientation = pose(xyzyaw)
    return columns.field(number, columns.join_columns(columns.field(1, position), columns.field(2, orientation)))


def _dense(samples: Sequence[Sample], numbers: RecordArray) -> list[Messages]:
    """The messages that each sample has besides images."""
    humans, there = people([sample.humans_xyzyaw for sample in samples])
    bodies = _poses(3, humans.reshape(-1, 4)).where(there.ravel()) if humans.size else None
    in_world = columns.constant(_IN_WORLD, len(samples))
    truth = columns.join_columns(
        columns.doubles(1, numbers["human_distance_m"], numbers["time_to_collision_s"]),
        columns.flags(3, numbers["human_visible"] != 0),
        columns.doubles(4, numbers["expert_cost"]),
        columns.flags(5, numbers["replanned"] != 0),
    )
    contents: tuple[tuple[schemas.Channel, Timed, list[Part]], ...] = (
        (schemas.ROBOT_POSE, Timed.FIRST, [in_world, _poses(3, numbers["pose"])]),
        (
            schemas.HUMANS,
            Timed.FIRST,
            [in_world, columns.fold_rows(bodies, len(samples))] if bodies else [in_world],
        ),
        (schemas.ACTION, Timed.NOWHERE, [columns.doubles(1, *numbers["action"].T)]),
        (schemas.GOAL, Timed.NOWHERE, [columns.doubles(1, *numbers["goal_xy_m"].T)]),
        (schemas.TRUTH, Timed.NOWHERE, [truth]),
    )
    return [Messages(channel=channel, timed=timed, groups=[parts]) for channel, timed, parts in contents]


def _outputs(samples: Sequence[Sample], header: EpisodeHeader) -> list[Messages]:
    """All images but the first camera's rgb, in the order of their channels."""
    found = []
    known = _known_images(tuple(camera.name for camera in header.cameras))
    for name, channel in schemas.output_channels(samples[0].outputs, known).items():
        photo = name == GOAL_IMAGE or kind_of(name) == RGB
        taken = [name in sample.outputs for sample in samples]
        images = [sample.outputs.get(name, b"") for sample in samples]
        found.append(_image(channel, images, taken, header.image_format if photo else FILE_FORMAT, camera_of(name)))
    return found


@functools.lru_cache(maxsize=16)
def _known_images(cameras: tuple[str, ...]) -> dict[str, schemas.Channel]:
    found = schemas.optional_channels(cameras)
    return {name: channel for name, channel in found.items() if channel.number in schemas.IMAGE_NUMBERS}


def _image(
    channel: schemas.Channel, images: Sequence[bytes], taken: Sequence[object], image_format: str, camera: str = ""
) -> Messages:
    files = Pieces(images)
    head = columns.field_head(2, files)
    end = columns.constant(_image_end(image_format, camera), len(images))
    there = None if all(taken) else np.array(list(map(bool, taken)))
    parts = (head.where(files.sizes > 0), files, end)
    return Messages(channel=channel, timed=Timed.FIRST, groups=[parts], there=there)


@functools.lru_cache(maxsize=32)
def _image_end(image_format: str, camera: str) -> bytes:
    frame = schemas.camera_frame(camera)
    return schemas.serialize(CompressedImage(frame_id=frame, format=image_format))


def _labels(samples: Sequence[Sample]) -> list[Messages]:
    found = [
        labels.messages(sample.labels, None, schemas.WORLD_FRAME, floor_m=sample.robot_xyzyaw[2]) for sample in samples
    ]
    joints, boxes, footprints = zip(*found, strict=True)
    most = max(len(update.entities) for update in boxes)
    entities: list[Part] = [
        Pieces([schemas.serialize(u.entities[k]) if k < len(u.entities) else b"" for u in boxes]) for k in range(most)
    ]
    groups: tuple[tuple[Timed, list[Part]], ...] = (
        (Timed.FIRST, [Pieces(list(map(schemas.serialize, joints)))]),
        (Timed.IN_ENTITIES, entities or [columns.nothing(len(samples))]),
        (Timed.FIRST, [Pieces(list(map(schemas.serialize, footprints)))]),
    )
    channels = schemas.LABEL_CHANNELS.values()
    return [
        Messages(channel=channel, timed=timed, groups=[[part] for part in parts])
        for channel, (timed, parts) in zip(channels, groups, strict=True)
    ]


def _commands(samples: Sequence[Sample], header: EpisodeHeader) -> Messages:
    there = [bool(sample.expert_commands) for sample in samples]
    rows = [_command(sample, header) if asked else b"" for sample, asked in zip(samples, there, strict=True)]
    return _messages(schemas.EXPERT_CHANNELS[schemas.EXPERT], rows, there)


def _command(sample: Sample, header: EpisodeHeader) -> bytes:
    v_mps, w_radps = zip(*sample.expert_commands, strict=True)
    return schemas.serialize(
        ExpertCommands(
            v_mps=v_mps,
            w_radps=w_radps,
            risks=sample.risks,
            image_every=header.image_every if header.image_every > 1 else 0,
            outcome=header.outcome.value,
            driver=header.driver.value,
            policy=header.policy,
        )
    )


def _drawn_messages(samples: Sequence[Sample], header: EpisodeHeader) -> Messages:
    there = [sample.seq == 0 for sample in samples]
    drawn = schemas.serialize(DrawnRobot(**header.drawn))
    return _messages(schemas.DRAWN_CHANNELS[schemas.DRAWN], [drawn if first else b"" for first in there], there)


def _messages(channel: schemas.Channel, rows: Sequence[bytes], there: Sequence[bool]) -> Messages:
    """Messages of some samples that have no time."""
    return Messages(channel=channel, timed=Timed.NOWHERE, groups=[[Pieces(rows)]], there=np.array(there))


_AFTER_OUTPUTS = next(iter(schemas.LABEL_CHANNELS.values())).number
_IN_WORLD = schemas.serialize(PoseInFrame(frame_id=schemas.WORLD_FRAME))
