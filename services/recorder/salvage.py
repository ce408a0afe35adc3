"""What a recorder finds in its folder when it starts: finished shards, and open ones that a crash left behind."""

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode

from readygo.common.dataset import EpisodeChunk, Provenance, ShardWriter, read_chunk
from readygo.common.dataset.index import index_path, load_index, map_file, read_provenance
from readygo.common.dataset.records import MAGIC, chunk_span, chunk_spans, is_intact, iter_records
from readygo.common.dataset.stage import PAUSE_NS, Scenery
from readygo.common.dataset.writer import PART_SUFFIX, is_shard_of, sync_folder
from readygo.common.errors import DatasetError
from readygo.common.messages import EpisodeKey

SALVAGE_SUFFIX = ".salvage"
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Durable:
    """An episode in a shard."""

    episode: EpisodeKey
    attempt: int
    shard: str
    sample_count: int
    policy: str
    """The offered policy that drove."""

    @classmethod
    def of_chunk(cls, chunk: EpisodeChunk, shard: str) -> "Durable":
        """The episode of a chunk in `shard`."""
        return cls(
            episode=chunk.episode,
            attempt=chunk.attempt,
            shard=shard,
            sample_count=chunk.sample_count,
            policy=chunk.ending.policy,
        )


@dataclass(frozen=True, kw_only=True)
class OpenShard:
    """A shard that was never finished, and the whole episodes in it."""

    path: Path
    provenance: Provenance | None
    chunks: tuple[EpisodeChunk, ...]


def finished_episodes(folder: Path, recorder: str) -> dict[int, Durable]:
    """The episodes in a recorder's finished shards, by index.

    Raises:
        DatasetError: If a shard is damaged.
    """
    episodes: dict[int, Durable] = {}
    for shard in _shards(folder, recorder):
        index = load_index(shard)
        for row, episode in enumerate(index.episodes):
            durable = Durable(
                episode=index.episode_key(row),
                attempt=int(episode["attempt"]),
                shard=shard.name,
                sample_count=int(episode["sample_count"]),
                policy=index.ending(row).policy,
            )
            episodes[durable.episode.index] = durable
    return episodes


def open_shards(folder: Path, recorder: str) -> list[OpenShard]:
    """The shards that a crash left open, with the episodes that can be saved."""
    return [read_open_shard(path) for path in _shards(folder, recorder, PART_SUFFIX)]


def read_open_shard(path: Path) -> OpenShard:
    """The whole episodes of an open shard: chunks that match their CRC-32 and end in a valid commit."""
    provenance: Provenance | None = None
    chunks: list[EpisodeChunk] = []
    try:
        with map_file(path) as view:
            if view[: len(MAGIC)] != MAGIC:
                raise DatasetError("it does not begin as an MCAP file")
            for record in iter_records(view):
                if record.opcode == Opcode.METADATA:
                    provenance = read_provenance(view, record) or provenance
                elif record.opcode == Opcode.CHUNK:
                    span = chunk_span(view, record)
                    if is_intact(view, span):
                        chunks.append(read_chunk(view[span.body : span.end]))
    except DatasetError as error:
        _log.info("%s ends after %d whole episodes: %s", path.name, len(chunks), error)
    return OpenShard(path=path, provenance=provenance, chunks=tuple(chunks))


def publish(
    shard: OpenShard, chunks: Sequence[EpisodeChunk], target: Path, *, stage: Scenery, start_ns: int, fsync: bool
) -> int:
    """Write episodes of an open shard as the finished shard `target`, then remove the open one.

    Args:
        shard: The open shard.
        chunks: Those of its episodes that are kept.
        target: The finished shard.
        stage: What viewers show around the samples.
        start_ns: When the first episode begins in the recorder's time.
        fsync: False trades durability for speed.

    Returns:
        When the next shard begins [ns].

    Raises:
        OSError: If the disk refused; the open shard is still there then.
    """
    next_ns = _write_chunks(shard, chunks, target, stage=stage, start_ns=start_ns, fsync=fsync)
    shard.path.unlink()
    if fsync:
        sync_folder(target.parent)
    return next_ns


def drop_episodes(path: Path, rows: Collection[int], stage: Scenery) -> bool:
    """Leave episodes of a finished shard out: another one takes its place, whole, and begins when it began.

    Args:
        path: The shard.
        rows: Of `ShardIndex.episodes`: what is left out.
        stage: What viewers show around the samples.

    Returns:
        False if nothing is left of the shard, and it was removed.

    Raises:
        OSError: If the disk refused; the shard is as it was then.
    """
    shard = read_open_shard(path)
    kept = [chunk for row, chunk in enumerate(shard.chunks) if row not in rows]
    if kept:
        _write_chunks(shard, kept, path, stage=stage, start_ns=shard.chunks[0].start_time_ns, fsync=True)
    else:
        path.unlink()
        index_path(path).unlink(missing_ok=True)
        sync_folder(path.parent)
    return bool(kept)


def _write_chunks(
    shard: OpenShard, chunks: Sequence[EpisodeChunk], target: Path, *, stage: Scenery, start_ns: int, fsync: bool
) -> int:
    """Write episodes of a shard as the finished shard `target`; when the next one begins [ns]."""
    outputs = chunks[0].outputs if chunks else ()
    provenance = shard.provenance or Provenance()
    writer = ShardWriter(
        target,
        provenance,
        outputs=outputs,
        stage=stage,
        start_ns=start_ns,
        fsync=fsync,
        part_suffix=SALVAGE_SUFFIX,
    )
    try:
        for chunk in chunks:
            writer.append(chunk)
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    return writer.next_start_ns


def next_start_ns(folder: Path, recorder: str) -> int:
    """Start of the episode after those of a recorder's finished shards, in the recorder's time [ns].

    Raises:
        DatasetError: If the last shard is damaged.
    """
    shards = _shards(folder, recorder)
    if not shards:
        return 0
    with map_file(shards[-1]) as view:
        return max(span.end_time_ns for span in chunk_spans(view)) + PAUSE_NS


def next_number(folder: Path, recorder: str) -> int:
    """A shard number that no file of the recorder has."""
    files = (file for suffix in ("", PART_SUFFIX, SALVAGE_SUFFIX) for file in _shards(folder, recorder, suffix))
    return max(map(_number, files), default=-1) + 1


def _shards(folder: Path, recorder: str, suffix: str = "") -> list[Path]:
    """A recorder's finished shards, or those whose names end in `suffix` besides, by number."""
    found = folder.glob(f"shard-{recorder}-*.mcap{suffix}")
    return sorted((shard for shard in found if is_shard_of(shard.name.removesuffix(suffix), recorder)), key=_number)


def _number(shard: Path) -> int:
    return int(shard.name.rsplit("-", 1)[1].split(".")[0])
