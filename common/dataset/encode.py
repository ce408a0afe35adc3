"""Samples to an episode's chunk: what is written and what is hashed are made of the same columns."""

import hashlib
import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Int64Array, RecordArray, UInt64Array
from readygo.common.dataset import columns, markers, packed, schemas
from readygo.common.dataset.canonical import EPISODE_SLOT_NS, HALF_PX, record_head, with_pixels_moved
from readygo.common.dataset.chunk import OUTPUT_DTYPE, SAMPLE_DTYPE, EpisodeChunk, constants
from readygo.common.dataset.columns import Column, Part
from readygo.common.dataset.packed import Messages
from readygo.common.dataset.poses import stored_yaw_rad
from readygo.common.dataset.records import MESSAGE_HEADER
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import DatasetError
from readygo.common.images.names import GOAL_IMAGE
from readygo.common.messages.samples import EpisodeHeader, Sample

HASHED_TOGETHER = 64


@dataclass(frozen=True, kw_only=True)
class ShardPlace:
    """Where in a shard an episode is shown."""

    stage: Scenery
    start_ns: int
    """When it begins in the shard's time [ns]."""
    with_map: bool
    """True for a shard's first episode, which has the map before its samples."""


def encode_episode(
    header: EpisodeHeader, attempt: int, samples: Sequence[Sample], place: ShardPlace | None = None
) -> EpisodeChunk:
    """Encode an episode as one chunk.

    Args:
        header: What is constant over the episode.
        attempt: The lease's number; only EpisodeCommit carries it.
        samples: All samples of the episode in order.
        place: Where it is shown, as `Scenery.stage_episode` would; None gives its canonical form.

    Raises:
        DatasetError: If samples are missing, do not all have the same outputs and their labels, or have numbers that
            no shard can hold.
    """
    if not samples or [sample.seq for sample in samples] != list(range(header.sample_count)):
        raise DatasetError(f"{_name(header)} has {header.sample_count} samples, got {len(samples)} to record.")
    for sample in samples:
        _check_alike(sample, samples[0], header)
    try:
        return _Encoder(header, samples, place).encode(attempt)
    except (struct.error, ValueError, OverflowError, TypeError, LookupError) as error:
        raise DatasetError(f"{_name(header)} cannot be recorded: {error}.") from error


def outputs_of(header: EpisodeHeader, sample: Sample) -> tuple[str, ...]:
    """The outputs of an episode's chunk, told by its first sample."""
    there = {*sample.outputs, *(schemas.LABEL_CHANNELS if header.labels else ())}
    if sample.expert_commands:
        there.add(schemas.EXPERT)
    if header.drawn:
        there.add(schemas.DRAWN)
    return tuple(name for name in _optional_channels(header) if name in there)


def _optional_channels(header: EpisodeHeader) -> dict[str, schemas.Channel]:
    return schemas.optional_channels(camera.name for camera in header.cameras)


class _Records:
    """Message records in a row."""

    def __init__(self, start_ns: int) -> None:
        self.start_ns = start_ns
        self.parts: list[bytes | memoryview] = []
        self.offsets: defaultdict[int, list[UInt64Array]] = defaultdict(
            list, {channel.number: [] for channel in schemas.CHANNELS}
        )
        """Rows of (log time [ns], offset) of the messages of each channel."""
        self.size = 0
        """Size of the records so far [bytes]."""

    def add(self, channel: schemas.Channel, payload: bytes, time_ns: int = 0) -> None:
        """Add a message of a time since the episode began."""
        log_ns = self.start_ns + time_ns
        self.parts += (record_head(channel.number, 0, log_ns, log_ns, len(payload)), payload)
        self.offsets[channel.number].append(np.array([[log_ns, self.size]], dtype=np.uint64))
        self.size += MESSAGE_HEADER.size + len(payload)

    def add_samples(self, messages: Sequence[Messages], times_ns: Sequence[int]) -> dict[schemas.Channel, RecordArray]:
        """Add the messages of samples at their times since the episode began; where each channel has its contents.

        These are images' files or else whole messages, rows of `OUTPUT_DTYPE`.
        """
        log_ns = np.array([self.start_ns + time_ns for time_ns in times_ns], dtype=np.uint64)
        stamps = columns.stamps(log_ns)
        parts: list[Part] = []
        sizes = []
        for each in messages:
            payload = each.at(stamps)
            head = columns.record_heads(each.channel.number, columns.sizes_of(payload), log_ns).where(each.there)
            parts += (head, *payload)
            sizes.append(columns.sizes_of((head, *payload)))
        table = np.stack(sizes, axis=1)
        ends = self.size + table.cumsum().reshape(table.shape)
        self.parts += columns.bytes_of(parts)
        self.size = int(ends[-1, -1])
        found = {}
        for each, begin, end in zip(messages, (ends - table).T, ends.T, strict=True):
            rows = np.stack([log_ns, begin.astype(np.uint64)], axis=1)
            self.offsets[each.channel.number].append(rows if each.there is None else rows[each.there])
            found[each.channel] = _places(each, stamps, begin + MESSAGE_HEADER.size, end)
        return found


def _places(messages: Messages, stamps: Column, begin: Int64Array, end: Int64Array) -> RecordArray:
    """Offset and length of each sample's image file, or else of its whole message, from `begin` to `end`."""
    places = np.zeros(len(begin), dtype=OUTPUT_DTYPE)
    if messages.channel.number in schemas.IMAGE_NUMBERS:
        head, files, _ = messages.groups[0]
        places["length"] = files.sizes
        places["offset"] = np.where(files.sizes > 0, begin + stamps.sizes + head.sizes, end)
    else:
        places["offset"], places["length"] = begin, end - begin
    if messages.there is not None:
        places[~messages.there] = 0
    return places


class _Encoder:
    """Makes an episode's chunk."""

    def __init__(self, header: EpisodeHeader, samples: Sequence[Sample], place: ShardPlace | None) -> None:
        self._header, self._samples, self._place = header, samples, place
        self._numbers = packed.numbers_of(samples)
        self._rows = _rows(samples, self._numbers)
        self._canonical = _Records(header.episode.index * EPISODE_SLOT_NS)
        self._records = _Records(place.start_ns) if place else self._canonical
        """Records as the shard holds them; the canonical form if no place is given."""

    def encode(self, attempt: int) -> EpisodeChunk:
        """The episode as one chunk."""
        header, records, samples = self._header, self._records, self._samples
        described = self._begin()
        places = self._add_samples()
        sha256 = _sha256(self._canonical.parts)
        commit = schemas.commit_message(header.episode, attempt, len(samples), sha256)
        records.add(schemas.EPISODE_COMMIT, commit, samples[-1].time_ns)
        images = places[schemas.IMAGE]
        self._rows["image_offset"], self._rows["image_length"] = images["offset"], images["length"]
        asked = schemas.EXPERT_CHANNELS[schemas.EXPERT] in places
        return EpisodeChunk(
            **described,
            attempt=attempt,
            sha256=sha256,
            data=b"".join(records.parts),
            start_time_ns=records.start_ns,
            end_time_ns=records.start_ns + samples[-1].time_ns,
            message_offsets={number: np.concatenate(rows) for number, rows in records.offsets.items() if rows},
            samples=self._rows,
            ending=schemas.Ending(header.outcome, header.driver, header.policy) if asked else schemas.Ending(),
            image_every=header.image_every,
            cameras=header.cameras,
            drawn=header.drawn,
            outputs={
                name: places[channel] for name, channel in _optional_channels(header).items() if channel in places
            },
        )

    def _begin(self) -> dict[str, Any]:
        """Add what an episode has once; the fields of its chunk that it tells."""
        header, place, canonical = self._header, self._place, self._canonical
        start = schemas.start_message(header)
        calibration, channel = schemas.calibration_message(header, canonical.start_ns), schemas.CALIBRATION
        further = packed.calibrations(header)
        _add_once(canonical, [(schemas.EPISODE_START, start), (channel, calibration)], further)
        if place:
            calibration = with_pixels_moved(schemas.calibration_message(header, place.start_ns), -HALF_PX)
            channel = schemas.ROS_CALIBRATION
            around = place.stage.of(header.drawn).surroundings(
                self._rows["pose"], header.goal_xy_m, place.start_ns, with_map=place.with_map
            )
            _add_once(self._records, [(schemas.EPISODE_START, start), (channel, calibration), *around], further)
        started = schemas.EPISODE_START.message.FromString(start)
        return constants(started, channel.message.FromString(calibration), channel)

    def _add_samples(self) -> dict[schemas.Channel, RecordArray]:
        """Add the messages of the samples, and what viewers need beside them; see `_Records.add_samples`."""
        messages = packed.messages(self._samples, self._header, self._numbers)
        times_ns = [sample.time_ns for sample in self._samples]
        places = self._canonical.add_samples(messages, times_ns)
        if self._place:
            stage = self._place.stage.of(self._header.drawn)
            places = self._records.add_samples(list(self._viewer_messages(messages, stage)), times_ns)
        return places

    def _viewer_messages(self, messages: Sequence[Messages], stage: Scenery) -> Iterator[Messages]:
        """The messages of samples and those that viewers need beside them."""
        for each in messages:
            yield each
            if each.channel is schemas.ROBOT_POSE:
                yield stage.frames(*packed.pose(self._numbers["pose"]))
            elif each.channel is schemas.HUMANS and not self._header.labels:
                yield markers.bodies(*packed.people([sample.humans_xyzyaw for sample in self._samples]))


def _add_once(
    records: _Records, own: Iterable[tuple[schemas.Channel, bytes]], further: Iterable[tuple[schemas.Channel, bytes]]
) -> None:
    """Add messages of an episode's beginning, and the calibrations of further cameras, which lack their times."""
    for channel, payload in own:
        records.add(channel, payload)
    for channel, payload in further:
        records.add(channel, packed.stamp(records.start_ns) + payload)


def _sha256(parts: Sequence[bytes | memoryview]) -> str:
    """SHA-256 of many pieces, some of them put together at a time: to copy costs less than a call for each."""
    sha256 = hashlib.sha256()
    for first in range(0, len(parts), HASHED_TOGETHER):
        sha256.update(b"".join(parts[first : first + HASHED_TOGETHER]))
    return sha256.hexdigest()


def _rows(samples: Sequence[Sample], numbers: RecordArray) -> RecordArray:
    """Rows of `SAMPLE_DTYPE` but for the places of images."""
    rows = np.zeros(len(samples), dtype=SAMPLE_DTYPE)
    for name in packed.NUMBERS_DTYPE.names or ():
        rows[name] = numbers[name]
    rows["time_ns"] = [sample.time_ns for sample in samples]
    rows["pose"][:, 3] = [stored_yaw_rad(sample.robot_xyzyaw[3]) for sample in samples]
    return rows


def _check_alike(sample: Sample, first: Sample, header: EpisodeHeader) -> None:
    """Raise DatasetError unless a sample has all that its header and the episode's first sample have, and no more."""
    taken = sample.seq % header.image_every == 0
    if bool(sample.image) != taken:
        raise DatasetError(
            f"{_name(header)} has images at every {header.image_every}. sample, but sample {sample.seq} has "
            f"{'none' if taken else 'one'}."
        )
    if (sample.outputs or first.outputs) and sample.outputs.keys() != _sample_outputs(first, sample.seq, taken):
        raise DatasetError(
            f"{_name(header)} has the outputs {sorted(first.outputs)} at sample 0, but "
            f"{sorted(sample.outputs)} at sample {sample.seq}."
        )
    if sample.seq == 0 and set(schemas.further_cameras(sample.outputs)) != {camera.name for camera in header.cameras}:
        raise DatasetError(
            f"{_name(header)} has images of the further cameras {sorted(schemas.further_cameras(sample.outputs))}, its "
            f"header names {sorted(camera.name for camera in header.cameras)}."
        )
    if len(sample.labels) != (len(sample.humans_xyzyaw) if header.labels else 0):
        raise DatasetError(
            f"{_name(header)} has {len(sample.labels)} labels for {len(sample.humans_xyzyaw)} humans at sample "
            f"{sample.seq}; its header says {'all' if header.labels else 'none'} are labelled."
        )
    if len(sample.expert_commands) != (len(first.expert_commands) if taken else 0):
        raise DatasetError(
            f"{_name(header)} has {len(first.expert_commands)} commands of the expert at sample 0, but "
            f"{len(sample.expert_commands)} at sample {sample.seq}."
        )


def _sample_outputs(first: Sample, seq: int, taken: bool) -> Set[str]:
    """The outputs of a sample."""
    if not taken:
        return frozenset()
    return first.outputs.keys() - {GOAL_IMAGE} if seq else first.outputs.keys()


def _name(header: EpisodeHeader) -> str:
    return f"Episode {header.episode.episode_id}"
