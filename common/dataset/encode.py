"""Samples to an episode's chunk, in one pass: what is written and what is hashed are made side by side."""

import hashlib
import struct
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.dataset import markers, packed, schemas
from readygo.common.dataset.canonical import EPISODE_SLOT_NS, HALF_PX, record_head, with_pixels_moved
from readygo.common.dataset.chunk import OUTPUT_DTYPE, SAMPLE_DTYPE, EpisodeChunk, constants
from readygo.common.dataset.packed import Content, Timed
from readygo.common.dataset.poses import stored_yaw_rad
from readygo.common.dataset.records import MESSAGE_HEADER
from readygo.common.dataset.stage import Stage
from readygo.common.errors import DatasetError
from readygo.common.images.names import GOAL_IMAGE
from readygo.common.messages.samples import EpisodeHeader, Sample


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where in a shard an episode is shown."""

    stage: Stage
    start_ns: int
    """When it begins in the shard's time [ns]."""
    with_map: bool
    """True for a shard's first episode, which has the map before its samples."""


def encode_episode(
    header: EpisodeHeader, attempt: int, samples: Sequence[Sample], place: Place | None = None
) -> EpisodeChunk:
    """Encode an episode as one chunk.

    Args:
        header: What is constant over the episode.
        attempt: The lease's number; only EpisodeCommit carries it.
        samples: All samples of the episode in order.
        place: Where it is shown, as `Stage.staged` would; None gives its canonical form.

    Raises:
        DatasetError: If samples are missing, do not all have the same outputs and their labels, or have numbers that
            no shard can hold.
    """
    if not samples or [sample.seq for sample in samples] != list(range(header.sample_count)):
        raise DatasetError(f"{_name(header)} has {header.sample_count} samples, got {len(samples)} to record.")
    for sample in samples:
        _check_alike(sample, samples[0], header)
    try:
        return _Encoder(header, samples, place).encoded(attempt)
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
    """Message records in a row: those of the shard, and the hash of those of the canonical form."""

    def __init__(self, canonical_ns: int, start_ns: int) -> None:
        self.canonical_ns, self.start_ns = canonical_ns, start_ns
        self.parts: list[bytes] = []
        self.offsets: defaultdict[int, list[tuple[int, int]]] = defaultdict(
            list, {channel.number: [] for channel in schemas.CHANNELS}
        )
        """(log time [ns], offset) of the messages of each channel."""
        self.size = 0
        """Bytes written so far."""
        self._sha256 = hashlib.sha256()
        self._unhashed: list[bytes] = []
        self.at(0)

    def at(self, time_ns: int) -> None:
        """What follows is of a time since the episode began."""
        self._sha256.update(b"".join(self._unhashed))
        self._unhashed.clear()
        self._canonical_ns, self._time_ns = self.canonical_ns + time_ns, self.start_ns + time_ns
        self._canonical_stamp, self.stamp = packed.stamp(self._canonical_ns), packed.stamp(self._time_ns)

    def add(self, content: Content, sequence: int) -> int:
        """Write and hash a message; where its payload begins."""
        channel, timed, parts = content
        if timed is Timed.NOWHERE:
            self.hash(channel.number, sequence, parts)
            return self.write(channel.number, sequence, parts)
        if timed is Timed.FIRST:
            self.hash(channel.number, sequence, (self._canonical_stamp, *parts))
            return self.write(channel.number, sequence, (self.stamp, *parts))
        self.hash(channel.number, sequence, content.at(self._canonical_stamp))
        return self.write(channel.number, sequence, content.at(self.stamp))

    def hash(self, number: int, sequence: int, payload: tuple[bytes, ...]) -> None:
        """Hash a message of the canonical form, its payload in pieces."""
        time_ns = self._canonical_ns
        self._unhashed.append(record_head(number, sequence, time_ns, time_ns, sum(map(len, payload))))
        self._unhashed += payload

    def write(self, number: int, sequence: int, payload: tuple[bytes, ...]) -> int:
        """Write a message, its payload in pieces; where the payload begins."""
        time_ns, size, offset = self._time_ns, sum(map(len, payload)), self.size
        self.parts.append(record_head(number, sequence, time_ns, time_ns, size))
        self.parts += payload
        self.offsets[number].append((time_ns, offset))
        begin = offset + MESSAGE_HEADER.size
        self.size = begin + size
        return begin

    def digest(self) -> str:
        """SHA-256 of what was hashed."""
        self.at(0)
        return self._sha256.hexdigest()


class _Encoder:
    """Makes an episode's chunk."""

    def __init__(self, header: EpisodeHeader, samples: Sequence[Sample], place: Place | None) -> None:
        base_ns = header.episode.index * EPISODE_SLOT_NS
        self._header, self._samples = header, samples
        self._stage = place.stage.of(header.drawn) if place else None
        self._records = _Records(base_ns, place.start_ns if place else base_ns)
        self._rows = _rows(samples)
        self._places: dict[int, npt.NDArray[np.void]] = {}
        self._described = self._begin(place)

    def _begin(self, place: Place | None) -> dict[str, Any]:
        """Write what an episode has once; the fields of its chunk that it tells."""
        records, header = self._records, self._header
        start = schemas.start_message(header)
        records.add(Content(schemas.EPISODE_START, Timed.NOWHERE, (start,)), 0)
        calibration, channel = schemas.calibration_message(header, records.canonical_ns), schemas.CALIBRATION
        records.hash(channel.number, 0, (calibration,))
        if place:
            channel = schemas.ROS_CALIBRATION
            calibration = with_pixels_moved(schemas.calibration_message(header, place.start_ns), -HALF_PX)
        records.write(channel.number, 0, (calibration,))
        started = schemas.EPISODE_START.message.FromString(start)
        described = constants(started, channel.message.FromString(calibration), channel)
        if place and self._stage:
            poses, goal_xy_m = self._rows["pose"], header.goal_xy_m
            for beside, payload in self._stage.surroundings(poses, goal_xy_m, place.start_ns, with_map=place.with_map):
                records.write(beside.number, 0, (payload,))
        for content in packed.calibrations(header):
            records.add(content, 0)
        return {**described, "cameras": header.cameras}

    def encoded(self, attempt: int) -> EpisodeChunk:
        """The whole chunk."""
        records, header, samples = self._records, self._header, self._samples
        for sample in samples:
            self._add(sample)
        sha256 = records.digest()
        records.at(samples[-1].time_ns)
        commit = schemas.commit_message(header.episode, attempt, len(samples), sha256)
        records.write(schemas.EPISODE_COMMIT.number, 0, (commit,))
        images = self._places.pop(schemas.IMAGE.number)
        self._rows["image_offset"], self._rows["image_length"] = images["offset"], images["length"]
        asked = schemas.EXPERT_CHANNELS[schemas.EXPERT].number in self._places
        return EpisodeChunk(
            **self._described,
            attempt=attempt,
            sha256=sha256,
            data=b"".join(records.parts),
            start_time_ns=records.start_ns,
            end_time_ns=records.start_ns + samples[-1].time_ns,
            message_offsets={number: offsets for number, offsets in records.offsets.items() if offsets},
            samples=self._rows,
            ending=schemas.Ending(header.outcome, header.driver, header.policy) if asked else schemas.Ending(),
            image_every=header.image_every,
            drawn=header.drawn,
            outputs={
                name: self._places[channel.number]
                for name, channel in _optional_channels(header).items()
                if channel.number in self._places
            },
        )

    def _add(self, sample: Sample) -> None:
        """Write the messages of a sample, and what viewers need beside them."""
        records = self._records
        records.at(sample.time_ns)
        for content in packed.contents(sample, self._header):
            body, channel = records.add(content, sample.seq), content.channel
            if channel.number in _PLACED:
                self._note_place(content, sample.seq, body)
            elif self._stage is None:
                continue
            elif channel is schemas.ROBOT_POSE:
                self._show(self._stage.frames(*packed.pose(sample.robot_xyzyaw)), sample.seq)
            elif channel is schemas.HUMANS and not self._header.labels:
                self._show(markers.bodies(human[:3] for human in sample.humans_xyzyaw), sample.seq)

    def _show(self, content: Content, sequence: int) -> None:
        self._records.write(content.channel.number, sequence, content.at(self._records.stamp))

    def _note_place(self, content: Content, sequence: int, body: int) -> None:
        """Note where an image's file is, or else the whole message."""
        places = self._places.get(content.channel.number)
        if places is None:
            places = self._places[content.channel.number] = np.zeros(len(self._samples), dtype=OUTPUT_DTYPE)
        end = self._records.size
        if content.channel.number in schemas.IMAGE_NUMBERS:
            head, image, _ = content.parts
            offset = body + len(self._records.stamp) + len(head) if image else end
            places[sequence] = (offset, len(image))
        else:
            places[sequence] = (body, end - body)


_PLACED = schemas.IMAGE_NUMBERS | frozenset(channel.number for channel in schemas.OPTIONAL_CHANNELS.values())


def _rows(samples: Sequence[Sample]) -> npt.NDArray[np.void]:
    """Rows of `SAMPLE_DTYPE` but for the places of images."""
    rows = [
        (
            sample.time_ns,
            0,
            0,
            (sample.action_v_mps, sample.action_w_radps),
            sample.goal_xy_robot_m,
            (*sample.robot_xyzyaw[:3], stored_yaw_rad(sample.robot_xyzyaw[3])),
            sample.human_distance_m,
            sample.time_to_collision_s,
            sample.expert_cost,
            sample.human_visible,
            sample.replanned,
        )
        for sample in samples
    ]
    return np.array(rows, dtype=SAMPLE_DTYPE)


def _check_alike(sample: Sample, first: Sample, header: EpisodeHeader) -> None:
    """Raise DatasetError unless a sample has all that its header and the episode's first sample have, and no more."""
    taken = sample.seq % header.image_every == 0
    if bool(sample.image) != taken:
        raise DatasetError(
            f"{_name(header)} has images at every {header.image_every}. sample, but sample {sample.seq} has "
            f"{'none' if taken else 'one'}."
        )
    wanted = first.outputs.keys() if sample.seq == 0 else first.outputs.keys() - {GOAL_IMAGE}
    if sample.outputs.keys() != (wanted if taken else set()):
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


def _name(header: EpisodeHeader) -> str:
    return f"Episode {header.episode.episode_id}"
