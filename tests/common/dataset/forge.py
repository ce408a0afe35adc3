"""Rewrites a shard with changed messages, checksums made valid again or not."""

import dataclasses
import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from readygo.common.dataset import ShardWriter, read_chunk, schemas
from readygo.common.dataset.chunk import EpisodeChunk
from readygo.common.dataset.index import index_path, load_index
from readygo.common.dataset.records import MESSAGE_HEADER, chunk_spans, iter_messages


@dataclasses.dataclass
class Record:
    channel: schemas.Channel
    sequence: int
    log_time_ns: int
    message: object


Change = Callable[[list[Record]], list[Record]]


def chunks_of(shard: Path) -> list[EpisodeChunk]:
    view = memoryview(shard.read_bytes())
    return [read_chunk(view[span.body : span.end]) for span in chunk_spans(view)]


def rewrite(shard: Path, change: Change, *, rehash: bool = True) -> None:
    """Change the messages of a shard's first episode; `rehash` mends its SHA-256, the CRCs are always right."""
    provenance, chunks = load_index(shard).provenance, chunks_of(shard)
    index_path(shard).unlink()
    with ShardWriter(shard, provenance, outputs=chunks[0].outputs, fsync=False) as writer:
        writer.append(_changed(chunks[0], change, rehash))
        for chunk in chunks[1:]:
            writer.append(chunk)
    # The index is what honest data would have had: it is not what these tests are about.
    index_path(shard).unlink()


def _changed(chunk: EpisodeChunk, change: Change, rehash: bool) -> EpisodeChunk:
    view = memoryview(chunk.data)
    by_number = {channel.number: channel for channel in schemas.channels_with(schemas.OPTIONAL_CHANNELS)}
    records = [
        Record(channel, m.sequence, m.log_time_ns, channel.message.FromString(view[m.body : m.end]))
        for m in iter_messages(view, 0, len(view))
        for channel in [by_number[m.channel]]
    ]
    data, offsets = bytearray(), {}
    for record in change(records):
        if record.channel is schemas.EPISODE_COMMIT and rehash:
            record.message.sha256 = hashlib.sha256(data).hexdigest()
        payload = record.message.SerializeToString()
        offsets.setdefault(record.channel.number, []).append((record.log_time_ns, len(data)))
        times = (record.log_time_ns, record.log_time_ns)
        data += MESSAGE_HEADER.pack(Opcode.MESSAGE, 22 + len(payload), record.channel.number, record.sequence, *times)
        data += payload
    return dataclasses.replace(
        chunk,
        data=bytes(data),
        message_offsets={number: np.array(rows, dtype=np.uint64) for number, rows in offsets.items()},
    )
