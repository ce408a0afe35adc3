"""The samples of several shards as rows of one table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Int32Array, Int64Array, RecordArray
from readygo.common.dataset.entries import EpisodePlace
from readygo.common.dataset.index import ShardIndex


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleTable:
    """Every sample of some episodes, one after the other, and where its bytes are."""

    rows: RecordArray
    """Rows of `readygo.common.dataset.chunk.SAMPLE_DTYPE`, shape (S,)."""
    payloads: Mapping[str, RecordArray]
    """Places of the samples' outputs, by optional channel that all shards have: rows of
    `readygo.common.dataset.chunk.OUTPUT_DTYPE`, shape (S,)."""
    shard: Int32Array
    """Number of each sample's shard, shape (S,)."""
    episode: Int32Array
    """Number of each sample's episode, shape (S,)."""
    first: Int64Array
    """The first sample of each sample's episode, shape (S,)."""

    @classmethod
    def of(cls, indexes: Sequence[ShardIndex], order: Sequence[EpisodePlace]) -> "SampleTable":
        """The samples in indexes, for episodes in an order."""
        counts = np.array([int(indexes[shard].episodes[row]["sample_count"]) for shard, row in order])
        common = [name for name in indexes[0].outputs if all(name in index.outputs for index in indexes)]

        def join_rows(arrays: Sequence[RecordArray]) -> RecordArray:
            return np.concatenate([arrays[shard][_span(indexes[shard], row)] for shard, row in order])

        return cls(
            rows=join_rows([index.samples for index in indexes]),
            payloads={name: join_rows([index.outputs[name] for index in indexes]) for name in common},
            shard=np.repeat(np.array([shard for shard, _ in order], dtype=np.int32), counts),
            episode=np.repeat(np.arange(len(counts), dtype=np.int32), counts),
            first=np.repeat(np.cumsum(counts) - counts, counts),
        )


def _span(index: ShardIndex, row: int) -> slice:
    """The samples of an episode among those of its shard."""
    first = int(index.episodes[row]["first_sample"])
    return slice(first, first + int(index.episodes[row]["sample_count"]))
