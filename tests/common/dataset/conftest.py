"""Shards to read and to damage."""

import pytest

from tests.common.dataset.episodes import write_shard


@pytest.fixture
def shard(tmp_path):
    return write_shard(tmp_path, [0, 1])


@pytest.fixture
def rich_shard(tmp_path):
    return write_shard(tmp_path, [0, 1], outputs=("depth", "mask"))


@pytest.fixture
def two_shards(tmp_path):
    """A folder with episodes 4 and 0 in a shard, and the longer episode 2 in another one."""
    write_shard(tmp_path, [4, 0], number=0)
    write_shard(tmp_path, [2], number=1, sample_count=30)
    return tmp_path


@pytest.fixture
def two_rich_shards(tmp_path):
    """Two shards that have depth and mask in common."""
    write_shard(tmp_path, [4, 0], number=0, outputs=("depth", "mask"), sample_count=5)
    write_shard(tmp_path, [2], number=1, outputs=("mask", "depth", "alpha"), sample_count=4)
    return tmp_path
