"""Bytes of shards at offsets, and whether they are sound, with a bound on how many files are open for it."""

import mmap
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from readygo.common.dataset.records import ChunkSpan, chunk_spans, is_intact
from readygo.common.errors import DatasetError
from readygo.common.files import open_regular

OPEN_MAX = 128
"""Shards that are mapped at the same time; each holds a file descriptor."""


class ShardFiles:
    """Shards that are mapped when they are read; the longest unread ones are closed first."""

    def __init__(self, shards: Sequence[Path]) -> None:
        """Open nothing yet.

        Args:
            shards: The files, which are asked for by their number.
        """
        self._shards = tuple(shards)
        self._maps: OrderedDict[int, mmap.mmap] = OrderedDict()
        self._spans: dict[int, list[ChunkSpan]] = {}
        """The chunks of each shard of which one was checked."""

    def __getstate__(self) -> dict[str, Any]:
        # Memory maps cannot be pickled; a data loader's worker opens its own.
        return {**self.__dict__, "_maps": OrderedDict()}

    def read(self, shard: int, offset: int, length: int) -> bytes:
        """Bytes of a shard.

        Args:
            shard: Number of the file.
            offset: Where they begin, from the beginning of the file.
            length: How many they are.
        """
        return self._map(shard)[offset : offset + length]

    def is_sound(self, shard: int, row: int) -> bool:
        """True if the bytes of an episode match their CRC-32: all of them are read.

        Args:
            shard: Number of the file.
            row: Which of its episodes.
        """
        with memoryview(self._map(shard)) as view:
            if shard not in self._spans:
                self._spans[shard] = _readable_spans(view)
            spans = self._spans[shard]
            return row < len(spans) and is_intact(view, spans[row])

    def close(self) -> None:
        """Close all files; what is read later opens them again."""
        while self._maps:
            self._maps.popitem()[1].close()

    def _map(self, shard: int) -> mmap.mmap:
        if shard in self._maps:
            self._maps.move_to_end(shard)
            return self._maps[shard]
        while len(self._maps) >= OPEN_MAX:
            self._maps.popitem(last=False)[1].close()
        with open_regular(self._shards[shard]) as file:
            self._maps[shard] = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        return self._maps[shard]


def _readable_spans(view: memoryview) -> list[ChunkSpan]:
    """The chunks of a shard, as far as its records can be followed."""
    spans: list[ChunkSpan] = []
    with suppress(DatasetError):
        for span in chunk_spans(view):
            spans.append(span)
    return spans
