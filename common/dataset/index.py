"""The offset index beside a shard: random access without parsing MCAP.

`shard-r0-00000.index` holds one row per sample and one per episode, and one more array per output besides rgb and per
kind of label that the shard has (NumPy's .npz layout). It names the size of its shard and the SHA-256 of the shard's
end; the end holds the CRC-32 of all that is before it. An index that is missing, of an older layout or of other bytes
is made again from the shard.
"""

import hashlib
import io
import json
import mmap
import os
import struct
from collections.abc import Iterator, Sequence, Sized
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Metadata

from readygo.common.array_files import load_npz
from readygo.common.arrays import RecordArray
from readygo.common.dataset.chunk import OUTPUT_DTYPE, SAMPLE_DTYPE, EpisodeChunk, read_chunk
from readygo.common.dataset.provenance import RECORD_NAME, Provenance, provenance_from_strings
from readygo.common.dataset.records import MAGIC, RECORD_HEADER, Record, chunk_span, is_intact, iter_records
from readygo.common.dataset.schemas import Ending
from readygo.common.errors import DatasetError, ReadygoError
from readygo.common.files import open_regular
from readygo.common.messages.episode import EpisodeKey, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.messages.samples import FurtherCamera

INDEX_FORMAT = "readygo-index/1"
EPISODE_DTYPE = np.dtype(
    [
        ("seed", "<u8"),
        ("split", "S8"),
        ("index", "<u8"),
        ("attempt", "<u4"),
        ("first_sample", "<u8"),
        ("sample_count", "<u4"),
        ("height_px", "<u4"),
        ("width_px", "<u4"),
        ("start_xyyaw", "<f8", (3,)),
        ("goal_xy_m", "<f8", (2,)),
        ("K_px", "<f8", (9,)),
        ("distortion_model", "S24"),
        ("distortion", "<f8", (8,)),
        ("sha256", "S64"),
    ]
)
"""One episode; `first_sample` is its first row among the shard's samples, `sha256` is hexadecimal."""
CAMERA_DTYPE = np.dtype(
    [
        ("name", "S16"),
        ("height_px", "<u4"),
        ("width_px", "<u4"),
        ("K_px", "<f8", (9,)),
        ("distortion_model", "S24"),
        ("distortion", "<f8", (8,)),
    ]
)
"""A camera besides the first one, in one episode."""
ENDING_DTYPE = np.dtype([("outcome", "S24"), ("driver", "S16"), ("policy", "S64")])
"""How an episode ended: the fields of `Ending`."""
_RECORDS = (EPISODE_DTYPE, SAMPLE_DTYPE, CAMERA_DTYPE, ENDING_DTYPE, OUTPUT_DTYPE)
FOOTER_SIZE = RECORD_HEADER.size + 8 + 8 + 4 + len(MAGIC)
DATA_END_SIZE = RECORD_HEADER.size + 4
_OUTPUT_PREFIX = "output_"
_CAMERAS = "cameras"
_ENDINGS = "endings"
"""Left out where all are usual, as they were before there were others."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShardIndex:
    """What a shard holds and where."""

    provenance: Provenance
    episodes: RecordArray
    """Rows of `EPISODE_DTYPE`, in the order of the shard."""
    samples: RecordArray
    """Rows of `SAMPLE_DTYPE`; `image_offset` counts from the beginning of the file."""
    size_bytes: int
    tail_sha256: str
    """SHA-256 of the shard from its end-of-data record on."""
    endings: RecordArray
    """Rows of `ENDING_DTYPE`, one per episode."""
    cameras: RecordArray
    """The cameras besides the first one, rows of `CAMERA_DTYPE`, shape (E, N)."""
    drawn: tuple[dict[str, float], ...] = ()
    """`EpisodeHeader.drawn` of each episode; empty where no robot has ranges."""
    outputs: dict[str, RecordArray] = field(default_factory=dict)
    """Place of each output besides rgb (images, labels, the expert's commands): rows of `OUTPUT_DTYPE`, one per sample;
    `offset` counts from the beginning of the file."""

    def episode_key(self, row: int) -> EpisodeKey:
        """Key of the episode in a row of `episodes`."""
        episode = self.episodes[row]
        return EpisodeKey(
            seed=int(episode["seed"]), split=Split(episode["split"].decode()), index=int(episode["index"])
        )

    def ending(self, row: int) -> Ending:
        """How the episode in a row of `episodes` ended, and who drove."""
        outcome, driver, policy = (value.decode() for value in self.endings[row])
        return Ending(Outcome(outcome), DriverKind(driver), policy)

    def equals(self, other: "ShardIndex") -> bool:
        """True if both describe the same shard in the same way."""
        return (
            (self.provenance, self.size_bytes, self.tail_sha256, self.drawn)
            == (other.provenance, other.size_bytes, other.tail_sha256, other.drawn)
            and self.episodes.tobytes() == other.episodes.tobytes()
            and self.samples.tobytes() == other.samples.tobytes()
            and self.endings.tobytes() == other.endings.tobytes()
            and self.cameras.tobytes() == other.cameras.tobytes()
            and {name: rows.tobytes() for name, rows in self.outputs.items()}
            == {name: rows.tobytes() for name, rows in other.outputs.items()}
        )


class IndexRows:
    """Collects the rows of an index, episode by episode."""

    def __init__(self) -> None:
        self._episodes: list[tuple[Any, ...]] = []
        self._samples: list[RecordArray] = []
        self._endings: list[tuple[bytes, ...]] = []
        self._cameras: list[list[tuple[Any, ...]]] = []
        self._drawn: list[dict[str, float]] = []
        self._outputs: list[dict[str, RecordArray]] = []
        self._sample_count = 0

    def add(self, chunk: EpisodeChunk, body_offset: int) -> None:
        """Add an episode whose chunk's records begin at `body_offset` in the file.

        Raises:
            DatasetError: If its outputs are not those of the episodes before.
        """
        key = chunk.episode
        outputs = {name: _shift_offsets(places, "offset", body_offset) for name, places in chunk.outputs.items()}
        first = self._outputs[0] if self._outputs else outputs
        if outputs.keys() != first.keys():
            raise DatasetError(f"episode {key.episode_id} has the outputs {list(outputs)}, others have {list(first)}")
        self._outputs.append(outputs)
        self._endings.append(_ending_row(chunk.ending))
        self._cameras.append([_camera_row(camera) for camera in chunk.cameras])
        self._drawn.append(chunk.drawn)
        self._episodes.append(
            (
                key.seed,
                key.split.value.encode(),
                key.index,
                chunk.attempt,
                self._sample_count,
                chunk.sample_count,
                chunk.height_px,
                chunk.width_px,
                chunk.start_xyyaw,
                chunk.goal_xy_m,
                chunk.K_px,
                chunk.distortion_model.encode(),
                _eight(chunk.distortion),
                chunk.sha256.encode(),
            )
        )
        self._samples.append(_shift_offsets(chunk.samples, "image_offset", body_offset))
        self._sample_count += chunk.sample_count

    def index(self, provenance: Provenance, *, size_bytes: int, tail: bytes | memoryview) -> ShardIndex:
        """The index of a shard of `size_bytes` that ends in `tail`."""
        return ShardIndex(
            # Through JSON, as a reader gets it.
            provenance=Provenance.from_mapping(json.loads(json.dumps(provenance.to_mapping()))),
            episodes=np.array(self._episodes, dtype=EPISODE_DTYPE),
            samples=np.concatenate(self._samples) if self._samples else np.zeros(0, dtype=SAMPLE_DTYPE),
            size_bytes=size_bytes,
            tail_sha256=hashlib.sha256(tail).hexdigest(),
            endings=np.array(self._endings, dtype=ENDING_DTYPE),
            cameras=np.array(self._cameras, dtype=CAMERA_DTYPE) if any(self._cameras) else _no_cameras(self._episodes),
            drawn=tuple(self._drawn) if any(self._drawn) else (),
            outputs={
                name: np.concatenate([outputs[name] for outputs in self._outputs])
                for name in (self._outputs[0] if self._outputs else ())
            },
        )


def _shift_offsets(rows: RecordArray, field_name: str, offset: int) -> RecordArray:
    """A copy of `rows` with `offset` added to one of their fields."""
    shifted = rows.copy()
    shifted[field_name] += np.uint64(offset)
    return shifted


def index_path(shard: Path) -> Path:
    """Where a shard's index is."""
    return shard.with_suffix(".index")


def load_index(shard: Path) -> ShardIndex:
    """A shard's index; made again, and stored if the folder can be written, when it is missing or does not match.

    Raises:
        DatasetError: If the shard is truncated or damaged.
    """
    with map_file(shard) as view:
        index = read_index(index_path(shard))
        if index is not None and (index.size_bytes, index.tail_sha256) == (len(view), _tail_sha256(view, shard)):
            return index
        index = build_index(view, shard)
    with suppress(OSError):
        write_index(index, index_path(shard))
    return index


def build_index(view: memoryview, shard: Path) -> ShardIndex:
    """The index of a finished shard, from its chunks.

    Raises:
        DatasetError: If the shard is truncated or damaged.
    """
    rows, provenance = IndexRows(), None
    end = tail_offset(view, shard)
    try:
        for record in iter_records(view):
            if record.opcode == Opcode.METADATA:
                provenance = read_provenance(view, record) or provenance
            elif record.opcode == Opcode.CHUNK:
                span = chunk_span(view, record)
                if not is_intact(view, span):
                    raise DatasetError(f"the chunk at byte {record.offset} does not match its CRC-32")
                rows.add(read_chunk(view[span.body : span.end]), span.body)
        if provenance is None:
            raise DatasetError("there is no readygo metadata in it")
    except DatasetError as error:
        raise DatasetError(f"Shard {shard} cannot be read: {error}; see `readygo validate {shard.parent}`.") from error
    return rows.index(provenance, size_bytes=len(view), tail=view[end:])


def read_provenance(view: memoryview, record: Record) -> Provenance | None:
    """The shard's provenance in a metadata record; None if the record is not one of readygo's.

    Raises:
        DatasetError: If it is of another format.
    """
    try:
        metadata = Metadata.read(ReadDataStream(io.BytesIO(view[record.body : record.end])))
    except (UnicodeDecodeError, EOFError, McapError, struct.error) as error:
        raise DatasetError(f"the metadata at byte {record.offset} cannot be read") from error
    return provenance_from_strings(metadata.metadata) if metadata.name == RECORD_NAME else None


def write_index(index: ShardIndex, path: Path, *, fsync: bool = False) -> None:
    """Write an index file, whole or not at all.

    Raises:
        OSError: If the disk refused.
    """
    header = {
        "format": INDEX_FORMAT,
        "metadata": index.provenance.to_mapping(),
        "size_bytes": index.size_bytes,
        "tail_sha256": index.tail_sha256,
        **({"drawn": index.drawn} if index.drawn else {}),
    }
    buffer = io.BytesIO()
    header_bytes = np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8)
    optional: dict[str, Any] = {f"{_OUTPUT_PREFIX}{name}": rows for name, rows in index.outputs.items()}
    if (index.endings != _usual_endings(len(index.episodes))).any():
        optional[_ENDINGS] = index.endings
    if index.cameras.size:
        optional[_CAMERAS] = index.cameras
    np.savez(buffer, header=header_bytes, episodes=index.episodes, samples=index.samples, **optional)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            file.write(buffer.getbuffer())
            file.flush()
            if fsync:
                os.fsync(file.fileno())
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def read_index(path: Path) -> ShardIndex | None:
    """An index file; None if it is missing, damaged or of another format."""
    try:
        # Nothing in it is compressed.
        arrays = load_npz(path, None, bytes_max=path.stat().st_size, raises=DatasetError, records=_RECORDS)
        header = json.loads(arrays["header"].tobytes())
        episodes, samples = arrays["episodes"], arrays["samples"]
        outputs = {
            name.removeprefix(_OUTPUT_PREFIX): rows for name, rows in arrays.items() if name.startswith(_OUTPUT_PREFIX)
        }
        endings = arrays[_ENDINGS] if _ENDINGS in arrays else _usual_endings(len(episodes))
        cameras = arrays[_CAMERAS] if _CAMERAS in arrays else _no_cameras(episodes)
        if header["format"] != INDEX_FORMAT or (episodes.dtype, samples.dtype) != (EPISODE_DTYPE, SAMPLE_DTYPE):
            return None
        if (endings.dtype, endings.shape) != (ENDING_DTYPE, episodes.shape):
            return None
        if (cameras.dtype, cameras.shape[:-1]) != (CAMERA_DTYPE, episodes.shape):
            return None
        if any((rows.dtype, rows.shape) != (OUTPUT_DTYPE, samples.shape) for rows in outputs.values()):
            return None
        index = ShardIndex(
            provenance=Provenance.from_mapping(header["metadata"]),
            episodes=episodes,
            samples=samples,
            size_bytes=header["size_bytes"],
            tail_sha256=header["tail_sha256"],
            endings=endings,
            cameras=cameras,
            drawn=tuple(header.get("drawn", ())),
            outputs=outputs,
        )
        return index if _is_sound(index) else None
    except (OSError, ReadygoError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _is_sound(index: ShardIndex) -> bool:
    """True if each row names samples and bytes that the shard can have, and words that mean something."""
    episodes, endings, size_bytes = index.episodes, index.endings, index.size_bytes
    counts = episodes["sample_count"].astype(np.int64)
    words = {
        "split": (episodes, {split.value for split in Split}),
        "outcome": (endings, {outcome.value for outcome in Outcome}),
        "driver": (endings, {driver.value for driver in DriverKind}),
    }
    texts = [
        rows[name]
        for rows in (episodes, endings, index.cameras)
        for name in rows.dtype.names or ()
        if rows.dtype[name].kind == "S"
    ]
    places = [(index.samples["image_offset"], index.samples["image_length"])]
    places += [(rows["offset"], rows["length"]) for rows in index.outputs.values()]
    return (
        type(size_bytes) is int
        and isinstance(index.tail_sha256, str)
        and len(index.drawn) in (0, len(episodes))
        and all(isinstance(drawn, dict) for drawn in index.drawn)
        and episodes.ndim == index.samples.ndim == 1
        and bool((episodes["first_sample"] == np.cumsum(counts) - counts).all())
        and int(counts.sum()) == len(index.samples)
        and all(b"".join(text.reshape(-1).tolist()).isascii() for text in texts)
        and all({text.decode() for text in rows[name].tolist()} <= known for name, (rows, known) in words.items())
        and all(bool((begin <= size_bytes).all() and (length <= size_bytes - begin).all()) for begin, length in places)
    )


def _camera_row(camera: FurtherCamera) -> tuple[Any, ...]:
    name, model = camera.name.encode(), camera.distortion_model.encode()
    return name, camera.height_px, camera.width_px, camera.K_px, model, _eight(camera.distortion)


def _eight(coefficients: Sequence[float]) -> tuple[float, ...]:
    return (*coefficients, *[0.0] * (8 - len(coefficients)))


def _no_cameras(episodes: Sized) -> RecordArray:
    return np.zeros((len(episodes), 0), dtype=CAMERA_DTYPE)


def _usual_endings(count: int) -> RecordArray:
    return np.array([_ending_row(Ending())] * count, dtype=ENDING_DTYPE)


def _ending_row(ending: Ending) -> tuple[bytes, ...]:
    return ending.outcome.value.encode(), ending.driver.value.encode(), ending.policy.encode()


@contextmanager
def map_file(path: Path) -> Iterator[memoryview]:
    """A file's bytes, memory-mapped.

    Raises:
        DatasetError: If the file is empty or cannot be read.
    """
    try:
        with open_regular(path) as file:
            mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DatasetError(f"Shard {path} cannot be read: {reason}.") from error
    view = memoryview(mapping)
    try:
        yield view
    finally:
        # A view that a caller kept holds the mapping open; it goes when that view goes.
        with suppress(BufferError):
            view.release()
            mapping.close()


def _tail_sha256(view: memoryview, shard: Path) -> str:
    return hashlib.sha256(view[tail_offset(view, shard) :]).hexdigest()


def tail_offset(view: memoryview, shard: Path) -> int:
    """Where the end-of-data record of a finished shard begins.

    Raises:
        DatasetError: If the shard has no proper end.
    """
    footer = len(view) - FOOTER_SIZE
    if footer >= len(MAGIC) and view[: len(MAGIC)] == MAGIC and view[-len(MAGIC) :] == MAGIC:
        opcode, length = RECORD_HEADER.unpack_from(view, footer)
        summary_start = int.from_bytes(view[footer + RECORD_HEADER.size : footer + RECORD_HEADER.size + 8], "little")
        if (opcode, length) == (Opcode.FOOTER, 20) and DATA_END_SIZE < summary_start <= footer:
            return summary_start - DATA_END_SIZE
    raise DatasetError(
        f"Shard {shard} is truncated or no readygo shard: its end is missing; "
        f"remove it, or restore it and run `readygo validate {shard.parent}`."
    )
