"""Recorded data: shards, their index, the reader and the check of everything in them."""

from common.dataset.chunk import EpisodeChunk, encode_episode, read_chunk
from common.dataset.reader import Calibration, Dataset, EpisodeEntry
from common.dataset.validate import Defect, Report, validate
from common.dataset.writer import ShardWriter, shard_name

__all__ = [
    "Calibration",
    "Dataset",
    "Defect",
    "EpisodeChunk",
    "EpisodeEntry",
    "Report",
    "ShardWriter",
    "encode_episode",
    "read_chunk",
    "shard_name",
    "validate",
]
