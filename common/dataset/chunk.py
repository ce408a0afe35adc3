"""An episode as the bytes of one MCAP chunk: what recorder workers agree on, wherever and whenever they run.

The chunk's times are simulated, there is no wall clock in it. In canonical form (`canonical`), as `encode_episode`
gives it, the same key gives the same bytes up to the last message, EpisodeCommit, which carries their SHA-256 and the
attempt. A shard's writer stages it for viewers (`stage`): it moves the episode to its place in the shard's time and
adds what viewers need. Both can be read, and the SHA-256 is that of the canonical form.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from readygo.common.arrays import RecordArray, UInt64Array
from readygo.common.dataset import schemas
from readygo.common.dataset.canonical import (
    HALF_PX,
    canonical_parts,
    canonical_sha256,
    is_canonical,
)
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.records import Message, field_span, iter_messages
from readygo.common.errors import DatasetError
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.samples import FurtherCamera

SAMPLE_DTYPE = np.dtype(
    [
        ("time_ns", "<i8"),
        ("image_offset", "<u8"),
        ("image_length", "<u4"),
        ("action", "<f4", (2,)),
        ("goal_xy_m", "<f4", (2,)),
        ("pose", "<f8", (4,)),
        ("human_distance_m", "<f4"),
        ("time_to_collision_s", "<f4"),
        ("expert_cost", "<f4"),
        ("human_visible", "?"),
        ("replanned", "?"),
    ]
)
"""One sample: action = v [m/s], w [rad/s]; goal in the robot's frame; pose = x, y, z [m], yaw [rad]."""
OUTPUT_DTYPE = np.dtype([("offset", "<u8"), ("length", "<u4")])
"""Offset and length of one sample's output [bytes]: an encoded image, or a whole message with labels or commands."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeChunk:
    """One episode, encoded; `data` are the chunk's uncompressed records."""

    episode: EpisodeKey
    attempt: int
    sha256: str
    data: bytes | memoryview
    start_time_ns: int
    end_time_ns: int
    height_px: int
    width_px: int
    start_xyyaw: tuple[float, float, float]
    goal_xy_m: tuple[float, float]
    K_px: tuple[float, ...]
    """Intrinsics [px] with pixel centres at +0.5, row-major, 9 numbers."""
    distortion_model: str
    distortion: tuple[float, ...]
    """Coefficients of the distortion model, at most 8."""
    message_offsets: dict[int, UInt64Array]
    """Rows of (log time [ns], offset in `data`) of the messages of each channel, shape (M, 2)."""
    samples: RecordArray
    """Rows of `SAMPLE_DTYPE`; `image_offset` counts from the beginning of `data`."""
    ending: schemas.Ending
    """Known where there are the expert's commands; without them an episode is a success of the expert."""
    image_every: int = 1
    """Samples from image to image, as `EpisodeHeader.image_every`."""
    cameras: tuple[FurtherCamera, ...] = ()
    """The cameras besides the first one; intrinsics with pixel centres at +0.5."""
    drawn: dict[str, float] = field(default_factory=dict)
    """Values that the episode's robot drew from its ranges, by the names of `RobotRanges`."""
    outputs: dict[str, RecordArray] = field(default_factory=dict)
    """Place of each output besides rgb (images, labels, the expert's commands): rows of `OUTPUT_DTYPE`, one per sample;
    `offset` counts from the beginning of `data`."""

    @property
    def sample_count(self) -> int:
        """Number of samples."""
        return len(self.samples)


_NUMBERS = (schemas.ACTION, schemas.GOAL, schemas.TRUTH)


def read_chunk(data: bytes | memoryview, *, sha256: str = "") -> EpisodeChunk:
    """The episode in a chunk's records.

    Args:
        data: The chunk's uncompressed records.
        sha256: The episode's hash where it is known already; otherwise it is computed.

    Raises:
        DatasetError: If the records are not one whole, committed episode with the hash that its commit names.
    """
    view = memoryview(data)
    messages = list(iter_messages(view, 0, len(view)))
    by_channel = _messages_by_channel(messages)
    calibration_channel = schemas.CALIBRATION if is_canonical(messages) else schemas.ROS_CALIBRATION
    start, calibration, commit = (
        _only(view, by_channel, channel)
        for channel in (schemas.EPISODE_START, calibration_channel, schemas.EPISODE_COMMIT)
    )
    commit_message = by_channel[schemas.EPISODE_COMMIT.number][0]
    if commit_message.end != len(view):
        raise DatasetError(f"episode {start.episode_id} continues after its commit")
    if commit.sha256 != (sha256 or canonical_sha256(view, messages, start.index)):
        raise DatasetError(f"episode {start.episode_id} does not match the SHA-256 of its commit")
    base_ns = by_channel[schemas.EPISODE_START.number][0].log_time_ns
    cameras = _cameras(view, by_channel)
    known = schemas.optional_channels(camera.name for camera in cameras)
    outputs = {name: c for name, c in known.items() if c.number in by_channel}
    commands = _first_commands(view, by_channel)
    taken = [message.sequence for message in by_channel[schemas.IMAGE.number]]
    every = schemas.image_every(commands, taken, len(by_channel[schemas.ROBOT_POSE.number]))
    rows = _sample_rows(view, by_channel, tuple(outputs.values()), base_ns, every)
    if not len(rows) == commit.sample_count == start.sample_count:
        raise DatasetError(f"episode {start.episode_id} has {len(rows)} samples, its commit says {commit.sample_count}")
    return EpisodeChunk(
        attempt=commit.attempt,
        sha256=commit.sha256,
        data=data,
        start_time_ns=base_ns,
        end_time_ns=commit_message.log_time_ns,
        **constants(start, calibration, calibration_channel),
        message_offsets={
            number: np.array([(message.log_time_ns, message.offset) for message in messages], dtype=np.uint64)
            for number, messages in by_channel.items()
            if messages
        },
        samples=rows,
        ending=schemas.ending_of(commands) if commands is not None else schemas.Ending(),
        image_every=every,
        cameras=cameras,
        drawn=_drawn_ranges(view, by_channel),
        outputs={
            name: _places(view, by_channel[channel.number], channel, len(rows)) for name, channel in outputs.items()
        },
    )


def constants(start: Any, calibration: Any, channel: schemas.Channel) -> dict[str, Any]:
    """The fields of an `EpisodeChunk` that an episode's start and its calibration on `channel` tell.

    Raises:
        DatasetError: If the calibration has another layout.
    """
    if len(calibration.K) != 9 or len(calibration.D) > 8:
        raise DatasetError(f"episode {start.episode_id} has a calibration of another layout")
    return {
        "episode": schemas.episode_key(start),
        "height_px": calibration.height,
        "width_px": calibration.width,
        "start_xyyaw": (start.start_x_m, start.start_y_m, start.start_yaw_rad),
        "goal_xy_m": (start.goal_x_m, start.goal_y_m),
        "K_px": intrinsics_px(calibration, channel),
        "distortion_model": calibration.distortion_model,
        "distortion": tuple(calibration.D),
    }


def canonical(chunk: EpisodeChunk) -> EpisodeChunk:
    """An episode in canonical form, however `chunk` holds it."""
    view = memoryview(chunk.data)
    messages = list(iter_messages(view, 0, len(view)))
    if is_canonical(messages):
        return chunk
    return read_chunk(b"".join(canonical_parts(view, messages, chunk.episode.index)), sha256=chunk.sha256)


def intrinsics_px(calibration: Any, channel: schemas.Channel) -> tuple[float, ...]:
    """Intrinsics with pixel centres at +0.5 [px], row-major, of a calibration with 9 numbers on `channel`."""
    K_px = list(calibration.K)
    if channel is schemas.ROS_CALIBRATION:
        K_px[2] += HALF_PX
        K_px[5] += HALF_PX
    return tuple(K_px)


def parse(channel: schemas.Channel, payload: memoryview) -> Any:
    """The message of a channel in its payload.

    Raises:
        DatasetError: If the payload is no such message.
    """
    try:
        return channel.message.FromString(payload)
    except DecodeError as error:
        raise DatasetError(f"a message on {channel.topic} cannot be read: {error}") from error


def _messages_by_channel(messages: Sequence[Message]) -> dict[int, list[Message]]:
    """The messages of each channel; channels besides `CHANNELS` that the episode has not are left out."""
    others = (*schemas.OPTIONAL_CHANNELS.values(), schemas.ROS_CALIBRATION, *schemas.VIEW_CHANNELS)
    known = {channel.number for channel in others} | schemas.IMAGE_NUMBERS
    known |= {camera.calibration.number for camera in schemas.NAMELESS_CAMERAS}
    by_channel: dict[int, list[Message]] = {channel.number: [] for channel in schemas.CHANNELS}
    for message in messages:
        if message.channel not in by_channel and message.channel not in known:
            raise DatasetError(f"a message is on the unknown channel {message.channel}")
        by_channel.setdefault(message.channel, []).append(message)
    return by_channel


def _only(view: memoryview, by_channel: dict[int, list[Message]], channel: schemas.Channel) -> Any:
    messages = by_channel[channel.number]
    if len(messages) != 1:
        raise DatasetError(f"an episode has {len(messages)} messages on {channel.topic}, not 1")
    return parse(channel, view[messages[0].body : messages[0].end])


def _cameras(view: memoryview, by_channel: dict[int, list[Message]]) -> tuple[FurtherCamera, ...]:
    """The cameras besides the first one: their calibrations name them."""
    found = []
    for of in schemas.NAMELESS_CAMERAS:
        if of.calibration.number not in by_channel:
            break
        message = _only(view, by_channel, of.calibration)
        found.append(further_camera(message))
    return tuple(found)


def further_camera(calibration: Any) -> FurtherCamera:
    """The camera besides the first one that a calibration of its channel tells of.

    Raises:
        DatasetError: If it has another layout.
    """
    try:
        return FurtherCamera(
            name=schemas.camera_of_frame(calibration.frame_id),
            height_px=calibration.height,
            width_px=calibration.width,
            K_px=intrinsics_px(calibration, schemas.ROS_CALIBRATION),
            distortion_model=calibration.distortion_model,
            distortion=tuple(calibration.D),
        )
    except (ValueError, IndexError) as error:
        raise DatasetError(f"the calibration of {calibration.frame_id} has another layout") from error


def _first_commands(view: memoryview, by_channel: dict[int, list[Message]]) -> Any:
    """The first message of the expert, which tells how the episode ended as all of them do; None without an expert."""
    channel = schemas.EXPERT_CHANNELS[schemas.EXPERT]
    found = by_channel.get(channel.number)
    return parse(channel, view[found[0].body : found[0].end]) if found else None


def _drawn_ranges(view: memoryview, by_channel: dict[int, list[Message]]) -> dict[str, float]:
    """What the robot drew from its ranges; nothing where it has none."""
    channel = schemas.DRAWN_CHANNELS[schemas.DRAWN]
    found = by_channel.get(channel.number)
    return schemas.drawn_of(parse(channel, view[found[0].body : found[0].end])) if found else {}


def _sample_rows(
    view: memoryview,
    by_channel: dict[int, list[Message]],
    outputs: tuple[schemas.Channel, ...],
    base_ns: int,
    image_every: int,
) -> RecordArray:
    poses = by_channel[schemas.ROBOT_POSE.number]
    times_ns = [message.log_time_ns for message in poses]
    for channel in (*schemas.SAMPLE_CHANNELS, *outputs):
        expected = schemas.samples_with(channel, len(poses), image_every)
        found = [(message.sequence, message.log_time_ns) for message in by_channel[channel.number]]
        if len(found) != len(expected):
            raise DatasetError(
                f"an episode of {len(poses)} samples has {len(found)} messages on {channel.topic}, not {len(expected)}"
            )
        for seq, pair in zip(expected, found, strict=True):
            if pair != (seq, times_ns[seq]):
                raise DatasetError(f"the messages of sample {seq} do not belong together")
    rows = np.zeros(len(poses), dtype=SAMPLE_DTYPE)
    dense = [by_channel[channel.number] for channel in (schemas.ROBOT_POSE, *_NUMBERS)]
    for seq, messages in enumerate(zip(*dense, strict=True)):
        rows[seq] = _sample_row(view, messages, base_ns)
    for message in by_channel[schemas.IMAGE.number]:
        rows["image_offset"][message.sequence], rows["image_length"][message.sequence] = _image_place(view, message)
    return rows


def _sample_row(view: memoryview, messages: tuple[Message, ...], base_ns: int) -> tuple[Any, ...]:
    """A row without its image."""
    pose, action, goal, truth = (
        parse(channel, view[message.body : message.end])
        for channel, message in zip((schemas.ROBOT_POSE, *_NUMBERS), messages, strict=True)
    )
    return (
        messages[0].log_time_ns - base_ns,
        0,
        0,
        (action.v_mps, action.w_radps),
        (goal.x_m, goal.y_m),
        pose_xyzyaw(pose.pose),
        truth.human_distance_m,
        truth.time_to_collision_s,
        truth.expert_cost,
        truth.human_visible,
        truth.replanned,
    )


def _places(view: memoryview, messages: list[Message], channel: schemas.Channel, sample_count: int) -> RecordArray:
    """Where each sample's message is; nowhere, with no length, for samples that have none."""
    places = np.zeros(sample_count, dtype=OUTPUT_DTYPE)
    for message in messages:
        if channel.number in schemas.IMAGE_NUMBERS:
            places[message.sequence] = _image_place(view, message)
        else:
            places[message.sequence] = (message.body, message.end - message.body)
    return places


def _image_place(view: memoryview, message: Message) -> tuple[int, int]:
    """Offset and length of the encoded image in a CompressedImage."""
    return field_span(view, message.body, message.end, schemas.IMAGE.message.DATA_FIELD_NUMBER)
