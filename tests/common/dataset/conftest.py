"""Shards that tests damage."""

import pytest

from tests.common.dataset.episodes import (
    write_shard,
)


@pytest.fixture
def shard(tmp_path):
    return write_shard(tmp_path, [0, 1])


@pytest.fixture
def rich_shard(tmp_path):
    return write_shard(tmp_path, [0, 1], outputs=("depth", "mask"))
