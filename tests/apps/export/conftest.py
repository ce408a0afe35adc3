import dataclasses
from pathlib import Path

import pytest

from readygo.apps.export.source import Source
from readygo.common.dataset import ShardWriter, encode_episode, shard_name
from readygo.common.messages import EpisodeKey, Split
from tests.common.dataset.episodes import PROVENANCE, make_episode

ROWS = {(Split.VAL, 4): 6, (Split.TRAIN, 0): 21, (Split.TRAIN, 2): 10}
"""Samples of each episode, in the order in which they are recorded."""


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two training episodes and one to validate, in two shards."""
    folder = tmp_path / "data"
    folder.mkdir()
    for number, ((split, index), count) in enumerate(ROWS.items()):
        header, samples = make_episode(index, count)
        header = dataclasses.replace(header, episode=EpisodeKey(seed=7, split=split, index=index))
        with ShardWriter(folder / shard_name("r0", number), PROVENANCE, fsync=False) as writer:
            writer.append(encode_episode(header, 1, samples))
    return folder


@pytest.fixture
def source(data: Path) -> Source:
    return Source([data])
