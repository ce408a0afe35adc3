"""Re-reads everything in a data folder and says what does not hold."""

import struct
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader

from readygo.common.dataset.aside import set_aside_lines
from readygo.common.dataset.episode_checks import ActionLimits, EpisodeChecks
from readygo.common.dataset.index import (
    DATA_END_SIZE,
    build_index,
    index_path,
    map_file,
    read_index,
    read_provenance,
    tail_offset,
)
from readygo.common.dataset.places import find_shards, shard_folders
from readygo.common.dataset.records import RECORD_HEADER, ChunkSpan, chunk_span, is_intact, iter_records
from readygo.common.dataset.schemas import output_of
from readygo.common.errors import ReadygoError
from readygo.common.files import open_regular
from readygo.common.messages.episode import EpisodeKey

_CHANNEL = struct.Struct("<HHI")
"""What a channel's record begins with: its number, that of its schema, and the length of its topic."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Defect:
    """One thing that does not hold."""

    shard: str
    """Name of the file."""
    kind: str
    """"file", "crc", "summary", "index", "sequence", "time", "sha256", "image", "label", "action", "motion",
    "goal", "frame", "duplicate", "metadata" or "missing"."""
    text: str
    """What does not hold, in words."""

    def __str__(self) -> str:
        return f"{self.shard}: {self.kind}: {self.text}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """What `validate` counted and found."""

    folder: Path
    """What was read."""
    shard_count: int
    """Finished shards."""
    episode_count: int
    """Episodes in them."""
    sample_count: int
    """Samples in them."""
    size_bytes: int
    """Their size on disk."""
    defects: tuple[Defect, ...]
    """All that does not hold; none in a sound folder."""
    notes: tuple[str, ...]
    """What is worth knowing but no defect, such as shards that are still open."""

    @property
    def ok(self) -> bool:
        """True if nothing was found."""
        return not self.defects


def validate(folder: str | Path, *, progress: Callable[[int, int], None] = lambda done, total: None) -> Report:
    """Check every shard of a folder.

    Args:
        folder: Data folder.
        progress: Called with the bytes read so far and all bytes.

    Raises:
        DatasetError: If the folder is missing or has no finished shards.
    """
    shards = find_shards(folder)
    check = _FolderCheck(Path(folder), sum(shard.stat().st_size for shard in shards), progress)
    for shard in shards:
        check.shard(shard)
    return check.report(len(shards))


class _FolderCheck:
    """Collects what is found, shard by shard."""

    def __init__(self, folder: Path, size_bytes: int, progress: Callable[[int, int], None]) -> None:
        self._folder = folder
        self._size_bytes = size_bytes
        self._progress = progress
        self._done_bytes = 0
        self._defects: list[Defect] = []
        self._notes: list[str] = []
        self._counts: Counter[str] = Counter()
        self._seen: dict[EpisodeKey, str] = {}
        self._robot: tuple[str, object] | None = None

    def shard(self, shard: Path) -> None:
        """Check one shard."""
        found_before = len(self._defects)
        size = shard.stat().st_size
        try:
            with map_file(shard) as view:
                self._records(shard, view)
                if len(self._defects) == found_before:
                    self._summary(shard, view)
                if len(self._defects) == found_before:
                    self._index(shard, view)
        except ReadygoError as error:
            self._add(shard, "file", str(error))
        self._done_bytes += size
        self._progress(self._done_bytes, self._size_bytes)

    def report(self, shard_count: int) -> Report:
        """All that was found."""
        parts = sum(len(list(place.glob("shard-*.mcap.part"))) for place in shard_folders(self._folder))
        if parts:
            self._notes.append(f"{parts} shards are open (.part): still written, or left by a crash.")
        self._notes += set_aside_lines(self._folder)
        return Report(
            folder=self._folder,
            shard_count=shard_count,
            episode_count=self._counts["episodes"],
            sample_count=self._counts["samples"],
            size_bytes=self._size_bytes,
            defects=tuple(self._defects),
            notes=tuple(self._notes),
        )

    def _add(self, shard: Path, kind: str, text: str) -> None:
        self._defects.append(Defect(shard=shard.name, kind=kind, text=text))

    def _records(self, shard: Path, view: memoryview) -> None:
        limits: ActionLimits | None = None
        outputs: list[str] = []
        for record in iter_records(view):
            if record.opcode == Opcode.METADATA:
                provenance = read_provenance(view, record)
                if provenance is not None:
                    limits = ActionLimits(provenance.robot)
                    self._metadata(shard, limits)
            if record.opcode == Opcode.CHANNEL:
                number, _, size = _CHANNEL.unpack_from(view, record.body)
                begin = record.body + _CHANNEL.size
                output = output_of(number, bytes(view[begin : min(begin + size, record.end)]).decode(errors="replace"))
                outputs += [output] if output else []
            if record.opcode != Opcode.CHUNK:
                continue
            span = chunk_span(view, record)
            if not is_intact(view, span):
                self._add(shard, "crc", f"the chunk at byte {record.offset} does not match its CRC-32")
            self._chunk(shard, view, span, limits or ActionLimits(None), tuple(outputs))
            self._progress(self._done_bytes + record.end, self._size_bytes)
        if limits is None:
            self._add(shard, "metadata", "there is no readygo metadata in it")

    def _metadata(self, shard: Path, limits: ActionLimits) -> None:
        if self._robot is None:
            self._robot = (shard.name, limits.robot)
            if limits.robot is None:
                self._notes.append("The metadata names no robot: its limits were not checked.")
        elif self._robot[1] != limits.robot:
            self._add(shard, "metadata", f"its robot is not that of {self._robot[0]}")

    def _chunk(
        self, shard: Path, view: memoryview, span: ChunkSpan, limits: ActionLimits, outputs: tuple[str, ...]
    ) -> None:
        checks = EpisodeChecks(view, span, limits, outputs)
        for kind, text in checks.run():
            self._add(shard, kind, text)
        self._counts["episodes"] += 1
        self._counts["samples"] += checks.sample_count
        if checks.episode is not None:
            if checks.episode in self._seen:
                first = self._seen[checks.episode]
                self._add(
                    shard,
                    "duplicate",
                    f"episode {checks.episode.episode_id} is in {first} already; see `readygo recover`",
                )
            self._seen.setdefault(checks.episode, shard.name)

    def _summary(self, shard: Path, view: memoryview) -> None:
        """Read the shard as any MCAP viewer would."""
        end = tail_offset(view, shard)
        if zlib.crc32(view[:end]) != int.from_bytes(view[end + RECORD_HEADER.size : end + DATA_END_SIZE], "little"):
            self._add(shard, "crc", "the bytes between the chunks do not match the file's CRC-32")
        try:
            with open_regular(shard) as file:
                reader = make_reader(file, validate_crcs=True)
                summary = reader.get_summary()
                # They are counted: their order costs time and changes nothing.
                count = sum(1 for _ in reader.iter_messages(log_time_order=False))
        except (McapError, ValueError, KeyError, struct.error, OverflowError, MemoryError) as error:
            self._add(shard, "summary", f"MCAP readers refuse it: {type(error).__name__}: {error}")
            return
        if summary is None or summary.statistics is None or summary.statistics.message_count != count:
            self._add(shard, "summary", f"its statistics do not match its {count} messages")

    def _index(self, shard: Path, view: memoryview) -> None:
        index, want = read_index(index_path(shard)), build_index(view, shard)
        if index is not None and not index.equals(want):
            self._add(shard, "index", f"{index_path(shard).name} does not match the shard; remove it")
        elif index is None and index_path(shard).exists():
            self._add(shard, "index", f"{index_path(shard).name} is damaged; remove it")
        elif index is None:
            self._notes.append(f"{shard.name} has no index; readers make it again.")
