"""Shards as they are written: one chunk per episode, durable before `append` returns.

Layout of a shard: header, metadata, schemas, channels; then per episode a chunk and its message indexes; then the end
of data, and the summary. While it is open, its name ends in ".part". A failed write is cut off again, so that the file
always ends after a whole episode. With a stage, time runs on from chunk to chunk: each episode begins `PAUSE_NS` after
the one before it, in the order in which they were appended.
"""

import errno
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from readygo.common.arrays import UInt64Array
from readygo.common.dataset import schemas
from readygo.common.dataset.chunk import EpisodeChunk, canonical
from readygo.common.dataset.index import IndexRows, index_path, write_index
from readygo.common.dataset.provenance import RECORD_NAME, Provenance, provenance_to_strings
from readygo.common.dataset.records import CHUNK_FIELDS, MAGIC, RECORD_HEADER, joined_crc32
from readygo.common.dataset.stage import PAUSE_NS, Scenery
from readygo.common.errors import DatasetError

PART_SUFFIX = ".part"


def shard_name(recorder: str, number: int) -> str:
    """File name of a recorder's finished shard."""
    return f"shard-{recorder}-{number:05d}.mcap"


def recorder_of_shard(name: str) -> str:
    """The recorder of a shard, finished or not, by its file name."""
    return name.removeprefix("shard-").rsplit("-", 1)[0]


def is_shard_of(name: str, recorder: str) -> bool:
    """True if a recorder may call a finished shard so."""
    return re.fullmatch(rf"shard-{re.escape(recorder)}-[0-9]{{5,}}\.mcap", name) is not None


def sync_folder(folder: Path) -> None:
    """Make the folder's entries durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class ShardWriter:
    """Writes one shard; use it as a context manager or call `close`."""

    def __init__(
        self,
        path: Path,
        provenance: Provenance,
        *,
        outputs: Iterable[str] = (),
        stage: Scenery | None = None,
        start_ns: int = 0,
        fsync: bool = True,
        part_suffix: str = PART_SUFFIX,
    ) -> None:
        """Open `path` + `part_suffix`.

        Args:
            path: The finished shard, see `shard_name`.
            provenance: What the shard says about its run.
            outputs: The images besides rgb, and the labels, that all samples of the shard have.
            stage: What viewers show around the samples; None writes episodes as they are given.
            start_ns: When the first episode begins on the stage.
            fsync: False trades durability for speed.
            part_suffix: Ending of the open file's name; its existing file is overwritten.

        Raises:
            OSError: If the file cannot be written; nothing is left of it then.
            DatasetError: If an output is unknown.
        """
        self.path = path
        self.outputs = tuple(schemas.output_channels(outputs))
        self.provenance = provenance
        self._part = path.with_name(path.name + part_suffix)
        self._fsync = fsync
        self._stage = stage
        self._channels = schemas.channels_with(self.outputs) if stage is None else schemas.staged_channels(self.outputs)
        self._rows = IndexRows()
        self.next_start_ns = start_ns
        """When the next episode would begin."""
        self._message_counts: Counter[int] = Counter()
        self._chunk_indexes: list[ChunkIndex] = []
        self._offset = 0
        self._data_crc32 = 0
        self._descriptor: int | None = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            head, self._metadata_index = _head(provenance_to_strings(provenance), self._channels)
            self._write(head)
            self._data_crc32 = zlib.crc32(head)
            if fsync:
                sync_folder(path.parent)
        except BaseException:
            self.abandon()
            self._part.unlink(missing_ok=True)
            raise

    def __enter__(self) -> "ShardWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    @property
    def is_open(self) -> bool:
        """False if nothing can be written any more."""
        return self._descriptor is not None

    @property
    def episode_count(self) -> int:
        """Number of durable episodes."""
        return len(self._chunk_indexes)

    def append(self, chunk: EpisodeChunk, *, placed: bool = False) -> None:
        """Write an episode and make it durable.

        Args:
            chunk: The episode.
            placed: True if it was encoded for its place here: at `next_start_ns`, on the shard's stage.

        Raises:
            OSError: If it could not be made durable; the file then ends after the episode before.
            DatasetError: If its outputs are not the shard's.
        """
        if tuple(chunk.outputs) != self.outputs:
            raise DatasetError(
                f"Episode {chunk.episode.episode_id} has the outputs {list(chunk.outputs)}, its shard "
                f"{list(self.outputs)}; begin a new shard."
            )
        if self._stage is not None and not placed:
            chunk = self._stage.stage_episode(canonical(chunk), self.next_start_ns, with_map=not self._chunk_indexes)
        crc32 = zlib.crc32(chunk.data)
        head, indexes, index = _chunk_record(chunk, crc32, self._offset)
        self._write(head, chunk.data, indexes)
        data_crc32 = joined_crc32(zlib.crc32(head, self._data_crc32), crc32, len(chunk.data))
        self._data_crc32 = zlib.crc32(indexes, data_crc32)
        self._rows.add(chunk, index.chunk_start_offset + _CHUNK_HEADER_SIZE)
        self._chunk_indexes.append(index)
        self.next_start_ns = chunk.end_time_ns + PAUSE_NS
        self._message_counts.update({number: len(rows) for number, rows in chunk.message_offsets.items()})

    def close(self) -> Path | None:
        """Write the summary and the index, and give the shard its final name.

        Returns:
            The finished shard; None if it had no episodes and was removed.

        Raises:
            OSError: If the disk refused; the file still holds all its episodes and `close` may be called again.
        """
        if not self._chunk_indexes:
            self._part.unlink()
            self.abandon()
            return None
        good_offset = self._offset
        data_end = _record_bytes(DataEnd(self._data_crc32))
        tail = data_end + self._summary(good_offset + len(data_end))
        self._write(tail)
        try:
            index = self._rows.index(self.provenance, size_bytes=self._offset, tail=tail)
            write_index(index, index_path(self.path), fsync=self._fsync)
            os.replace(self._part, self.path)
        except OSError:
            self._cut(good_offset)
            raise
        self.abandon()
        if self._fsync:
            sync_folder(self.path.parent)
        return self.path

    def abandon(self) -> None:
        """Close the file as it is; an open shard stays for salvage."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _write(self, *parts: bytes | memoryview) -> None:
        """Write all parts durably, or nothing."""
        if self._descriptor is None:
            raise OSError(errno.EBADF, "the shard is not open any more", str(self._part))
        start = self._offset
        try:
            for part in parts:
                view = memoryview(part)
                while view:
                    view = view[os.write(self._descriptor, view) :]
            if self._fsync:
                os.fsync(self._descriptor)
        except OSError:
            self._cut(start)
            raise
        self._offset = start + sum(map(len, parts))

    def _cut(self, offset: int) -> None:
        assert self._descriptor is not None
        try:
            os.ftruncate(self._descriptor, offset)
            os.lseek(self._descriptor, offset, os.SEEK_SET)
        except OSError:
            # What is behind `offset` is unknown now: nothing may follow it.
            self.abandon()
            raise
        self._offset = offset

    def _summary(self, summary_start: int) -> bytes:
        builder = RecordBuilder()
        offsets: list[SummaryOffset] = []
        groups: list[tuple[int, list[Any]]] = [
            (Opcode.SCHEMA, _schema_records(self._channels)),
            (Opcode.CHANNEL, _channel_records(self._channels)),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.METADATA_INDEX, [self._metadata_index]),
        ]
        for opcode, records in groups:
            start = builder.count
            for record in records:
                record.write(builder)
            if builder.count > start:
                offsets.append(SummaryOffset(opcode, summary_start + start, builder.count - start))
        offsets_start = summary_start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = _finish_buffer(builder)
        footer = _record_bytes(Footer(summary_start, offsets_start, 0))
        # The footer's own CRC field is its last four bytes and not covered.
        crc32 = zlib.crc32(footer[:-4], zlib.crc32(summary))
        return summary + _record_bytes(Footer(summary_start, offsets_start, crc32)) + MAGIC

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(sorted(self._message_counts.items())),
            chunk_count=len(self._chunk_indexes),
            message_count=self._message_counts.total(),
            message_start_time=min(index.message_start_time for index in self._chunk_indexes),
            message_end_time=max(index.message_end_time for index in self._chunk_indexes),
            metadata_count=1,
            schema_count=len(schemas.schema_numbers(self._channels)),
        )


_MESSAGE_INDEX = struct.Struct("<BQHI")
"""Opcode, length, channel, size of the entries: log time [ns] and offset of every message."""
_CHUNK_HEADER_SIZE = RECORD_HEADER.size + CHUNK_FIELDS.size + 4 + 8


def _head(metadata: dict[str, str], channels: Sequence[schemas.Channel]) -> tuple[bytes, MetadataIndex]:
    before = MAGIC + _record_bytes(Header(profile="", library="readygo"))
    record = _record_bytes(Metadata(name=RECORD_NAME, metadata=metadata))
    index = MetadataIndex(offset=len(before), length=len(record), name=RECORD_NAME)
    records = [*_schema_records(channels), *_channel_records(channels)]
    return before + record + b"".join(map(_record_bytes, records)), index


def _schema_records(channels: Sequence[schemas.Channel]) -> list[Schema]:
    return [
        Schema(
            id=number,
            name=message.DESCRIPTOR.full_name,
            encoding="protobuf",
            data=schemas.descriptor_set(message),
        )
        for message, number in schemas.schema_numbers(channels).items()
    ]


def _channel_records(channels: Sequence[schemas.Channel]) -> list[Channel]:
    numbers = schemas.schema_numbers(channels)
    return [
        Channel(
            id=channel.number,
            schema_id=numbers[channel.message],
            topic=channel.topic,
            message_encoding="protobuf",
            metadata={},
        )
        for channel in channels
    ]


def _chunk_record(chunk: EpisodeChunk, crc32: int, offset: int) -> tuple[bytes, bytes, ChunkIndex]:
    """What goes before a chunk's data, the message indexes behind them, and the chunk's entry in the summary.

    The first of them is written at `offset`.
    """
    size = len(chunk.data)
    header = RECORD_HEADER.pack(Opcode.CHUNK, _CHUNK_HEADER_SIZE - RECORD_HEADER.size + size) + CHUNK_FIELDS.pack(
        chunk.start_time_ns, chunk.end_time_ns, size, crc32
    )
    header += bytes(4) + size.to_bytes(8, "little")
    position = offset + len(header) + size
    index_offsets: dict[int, int] = {}
    indexes: list[bytes] = []
    for number, records in chunk.message_offsets.items():
        index_offsets[number] = position
        indexes.append(_message_index(number, records))
        position += len(indexes[-1])
    index = ChunkIndex(
        chunk_length=len(header) + size,
        chunk_start_offset=offset,
        compression="",
        compressed_size=size,
        message_end_time=chunk.end_time_ns,
        message_index_length=position - offset - len(header) - size,
        message_index_offsets=index_offsets,
        message_start_time=chunk.start_time_ns,
        uncompressed_size=size,
    )
    return header, b"".join(indexes), index


def _message_index(number: int, records: UInt64Array) -> bytes:
    """The record of a channel's message index."""
    entries = records.astype("<u8").tobytes()
    return _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), number, len(entries)) + entries


def _record_bytes(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return _finish_buffer(builder)


def _finish_buffer(builder: Any) -> bytes:
    data: bytes = builder.end()
    return data
