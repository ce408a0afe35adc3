"""Episodes of a data folder while it is still recorded: those of finished shards, and the whole ones of open shards.

Files are read, not mapped: a recorder may cut an open one.
"""

import os
import struct
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from mcap.opcode import Opcode

from readygo.common.dataset import schemas
from readygo.common.dataset.chunk import EpisodeChunk, parse, read_chunk
from readygo.common.dataset.labels import boxes_of, footprints_of, joints_of
from readygo.common.dataset.places import shard_folders
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.records import (
    CHUNK_FIELDS,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    Record,
    chunk_span,
    is_intact,
    iter_messages,
)
from readygo.common.dataset.writer import PART_SUFFIX
from readygo.common.errors import DatasetError
from readygo.common.files import open_regular
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.learning import CommittedEpisode
from readygo.common.messages.samples import EpisodeHeader, HumanLabels, Sample, sample_crc32

Messages = Mapping[int, dict[int, Any]]
"""Those of an episode by the number of their channel, in order."""
_START_MAX = CHUNK_FIELDS.size + 12 + 65_536
"""A chunk's fields and the first message of its episode are shorter [bytes]."""


def committed_episodes(folder: Path, known: Collection[EpisodeKey] = ()) -> Iterator[CommittedEpisode]:
    """The durable episodes of a data folder, also of one that is being recorded, as their recorder published them.

    Args:
        folder: The data folder of one run.
        known: Episodes to leave out; little is read of them.

    Raises:
        DatasetError: If a finished shard is damaged or cut off; it names the file. Open shards end where they end.
    """
    seen = set(known)
    for path in _shards(shard_folders(folder)):
        for chunk in _chunks(path, lambda key: key not in seen):
            seen.add(chunk.episode)
            yield _episode(chunk)


def committed_episode(folders: Iterable[Path], wanted: EpisodeKey) -> CommittedEpisode | None:
    """A durable episode of a run, also of one that is being recorded; None where it is not there.

    Args:
        folders: Those with its shards, see `readygo.common.dataset.places`.
        wanted: Which episode.

    Raises:
        DatasetError: As `committed_episodes`.
    """
    chunks = (chunk for path in _shards(folders) for chunk in _chunks(path, lambda key: key == wanted))
    return next(map(_episode, chunks), None)


def _shards(folders: Iterable[Path]) -> list[Path]:
    """Finished ones, then open ones."""
    patterns = ("shard-*.mcap", f"shard-*.mcap{PART_SUFFIX}")
    places = list(folders)
    return [path for pattern in patterns for place in places for path in sorted(place.glob(pattern))]


def episode_keys(shard: Path) -> list[EpisodeKey]:
    """The episodes of a shard, finished or open, as far as it can be read; little is read."""
    keys: list[EpisodeKey] = []
    with suppress(OSError, DatasetError), open_regular(shard) as file:
        keys.extend(key for key, *_ in _places(file))
    return keys


def episode_indices(shard: Path, begin: int = 0) -> Iterator[tuple[int, int]]:
    """Indices of the episodes that begin in a shard, finished or open, as far as it can be read; little is read.

    Args:
        shard: Its file.
        begin: Byte to begin at: an end that was told before; 0 is the file's beginning.

    Yields:
        The index of an episode, and the byte where its chunk ends.
    """
    with suppress(OSError, DatasetError), open_regular(shard) as file:
        for key, _, body, length in _places(file, begin):
            yield key.index, body + length


def _chunks(path: Path, wanted: Callable[[EpisodeKey], bool]) -> Iterator[EpisodeChunk]:
    is_open = path.suffix == PART_SUFFIX
    try:
        file = open_regular(path)
    except FileNotFoundError:
        # It was finished, or saved under another name, since the folder was listed.
        path = path.with_suffix("") if is_open else path
        if not path.exists():
            return
        file, is_open = open_regular(path), False
    except OSError as error:
        raise DatasetError(f"Shard {path} cannot be read: {error.strerror or error}.") from error
    with file:
        try:
            yield from _whole_chunks(file, wanted)
        except DatasetError as error:
            if not is_open:
                hint = f"see `readygo validate {path.parent}`"
                raise DatasetError(f"Shard {path} cannot be read: {error}; {hint}.") from error


def _whole_chunks(file: BinaryIO, wanted: Callable[[EpisodeKey], bool]) -> Iterator[EpisodeChunk]:
    """The chunks of a shard whose episodes are `wanted`, up to its footer."""
    for key, offset, body, length in _places(file):
        if wanted(key):
            file.seek(body)
            yield _chunk(file.read(length), offset)


def _places(file: BinaryIO, begin: int = 0) -> Iterator[tuple[EpisodeKey, int, int, int]]:
    """The chunks of a shard from a record on to its footer: episode, where record and body begin, the body's length."""
    size = os.fstat(file.fileno()).st_size
    if begin:
        file.seek(begin)
    elif file.read(len(MAGIC)) != MAGIC:
        raise DatasetError("it does not begin as an MCAP file")
    opcode = 0
    while opcode != Opcode.FOOTER:
        offset, head = file.tell(), file.read(RECORD_HEADER.size)
        if len(head) < RECORD_HEADER.size:
            raise DatasetError(f"the file ends at byte {offset} without a footer")
        opcode, length = RECORD_HEADER.unpack(head)
        body = offset + RECORD_HEADER.size
        if body + length > size:
            raise DatasetError(f"the record at byte {offset} is cut off")
        if opcode == Opcode.CHUNK:
            yield _key(file.read(min(length, _START_MAX)), offset), offset, body, length
        file.seek(body + length)


def _key(begin: bytes, offset: int) -> EpisodeKey:
    """The episode of a chunk of which only the beginning is given."""
    try:
        first = CHUNK_FIELDS.size + 12
        _, length, channel, *_ = MESSAGE_HEADER.unpack_from(begin, first)
    except struct.error as error:
        raise DatasetError(f"the chunk at byte {offset} is cut off") from error
    body, end = first + MESSAGE_HEADER.size, first + RECORD_HEADER.size + length
    if channel != schemas.EPISODE_START.number or end > len(begin):
        raise DatasetError(f"the chunk at byte {offset} does not begin with an episode's start")
    return schemas.episode_key(parse(schemas.EPISODE_START, memoryview(begin)[body:end]))


def _chunk(data: bytes, offset: int) -> EpisodeChunk:
    """The episode in the body of the chunk record at `offset`."""
    view = memoryview(data)
    span = chunk_span(view, Record(Opcode.CHUNK, 0, 0, len(data)))
    if not is_intact(view, span):
        raise DatasetError(f"the chunk at byte {offset} does not match its CRC-32")
    return read_chunk(view[span.body : span.end])


def _episode(chunk: EpisodeChunk) -> CommittedEpisode:
    optional = schemas.optional_channels(camera.name for camera in chunk.cameras)
    channels = {channel.number: channel for channel in (*schemas.CHANNELS, *optional.values())}
    messages: Messages = {number: {} for number in channels}
    view = memoryview(chunk.data)
    for message in iter_messages(view, 0, len(view)):
        if message.channel in channels:
            payload = view[message.body : message.end]
            messages[message.channel][message.sequence] = parse(channels[message.channel], payload)
    return CommittedEpisode(
        header=_header(chunk, messages),
        attempt=chunk.attempt,
        samples=tuple(_sample(chunk, messages, seq) for seq in range(chunk.sample_count)),
    )


def _header(chunk: EpisodeChunk, messages: Messages) -> EpisodeHeader:
    start = messages[schemas.EPISODE_START.number][0]
    return EpisodeHeader(
        episode=chunk.episode,
        sample_count=chunk.sample_count,
        goal_xy_m=chunk.goal_xy_m,
        start_xyyaw=chunk.start_xyyaw,
        avatars=tuple(start.avatars),
        encounters=tuple(start.encounters),
        image_format=start.image_format,
        height_px=chunk.height_px,
        width_px=chunk.width_px,
        K_px=chunk.K_px,
        distortion_model=chunk.distortion_model,
        distortion=chunk.distortion,
        labels="joints" in chunk.outputs,
        outcome=chunk.ending.outcome,
        driver=chunk.ending.driver,
        policy=chunk.ending.policy,
        image_every=chunk.image_every,
        cameras=chunk.cameras,
        drawn=chunk.drawn,
    )


def _sample(chunk: EpisodeChunk, messages: Messages, seq: int) -> Sample:
    pose, humans, action, goal, truth = (messages[channel.number][seq] for channel in schemas.SAMPLE_CHANNELS[1:])
    taken = messages[schemas.IMAGE.number].get(seq)
    image = taken.data if taken is not None else b""
    outputs = {
        name: messages[channel.number][seq].data
        for name, channel in schemas.optional_channels(camera.name for camera in chunk.cameras).items()
        if channel.number in schemas.IMAGE_NUMBERS and seq in messages[channel.number]
    }
    asked = messages[schemas.EXPERT_CHANNELS[schemas.EXPERT].number].get(seq)
    return Sample(
        seq=seq,
        crc32=sample_crc32(image, outputs),
        time_ns=int(chunk.samples["time_ns"][seq]),
        image=image,
        action_v_mps=action.v_mps,
        action_w_radps=action.w_radps,
        goal_xy_robot_m=(goal.x_m, goal.y_m),
        robot_xyzyaw=pose_xyzyaw(pose.pose),
        humans_xyzyaw=tuple(map(pose_xyzyaw, humans.poses)),
        human_distance_m=truth.human_distance_m,
        time_to_collision_s=truth.time_to_collision_s,
        human_visible=truth.human_visible,
        expert_cost=truth.expert_cost,
        replanned=truth.replanned,
        outputs=outputs,
        labels=_labels(messages, seq) if "joints" in chunk.outputs else (),
        expert_commands=tuple(zip(asked.v_mps, asked.w_radps, strict=True)) if asked is not None else (),
        risks=asked.risks if asked is not None else b"",
    )


def _labels(messages: Messages, seq: int) -> tuple[HumanLabels, ...]:
    joints, boxes, footprints = (messages[channel.number][seq] for channel in schemas.LABEL_CHANNELS.values())
    labels = zip(joints_of(joints), boxes_of(boxes), footprints_of(footprints), strict=True)
    return tuple(HumanLabels(joints_m=body, box=box, footprint_xy_m=ground) for body, box, ground in labels)
