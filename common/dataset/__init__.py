"""Recorded data: shards, their index, the reader and the check of everything in them."""

from readygo.common.dataset.calibration import Calibration
from readygo.common.dataset.chunk import EpisodeChunk, read_chunk
from readygo.common.dataset.clarity import RecordedClarity, recorded_clarity
from readygo.common.dataset.committed import committed_episodes
from readygo.common.dataset.encode import ShardPlace, encode_episode
from readygo.common.dataset.entries import EpisodeEntry
from readygo.common.dataset.provenance import Provenance, SceneOrigin
from readygo.common.dataset.reader import Dataset
from readygo.common.dataset.validate import Defect, Report, validate
from readygo.common.dataset.writer import ShardWriter, shard_name

__all__ = [
    "Calibration",
    "Dataset",
    "Defect",
    "EpisodeChunk",
    "EpisodeEntry",
    "ShardPlace",
    "Provenance",
    "RecordedClarity",
    "Report",
    "SceneOrigin",
    "ShardWriter",
    "committed_episodes",
    "encode_episode",
    "read_chunk",
    "recorded_clarity",
    "shard_name",
    "validate",
]
