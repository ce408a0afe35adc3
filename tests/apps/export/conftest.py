import dataclasses
from pathlib import Path

import pytest

from readygo.apps.export.source import ExportSource
from readygo.common.dataset import ShardWriter, encode_episode, shard_name
from readygo.common.messages import EpisodeKey, Split
from readygo.common.messages.plan import Outcome
from tests.common.dataset.episodes import PROVENANCE, make_episode
from tests.crooked import ODD_RATES, write_crooked_shard

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
def source(data: Path) -> ExportSource:
    return ExportSource([data])


@pytest.fixture
def crooked_source(tmp_path: Path) -> ExportSource:
    """Two episodes of a crooked robot at 30 steps and 15 images a second: a collision with a human, and a timeout."""
    for index, outcome in ((3, Outcome.HUMAN_COLLISION), (8, Outcome.TIMEOUT)):
        folder = tmp_path / f"crooked-{index}"
        write_crooked_shard(folder, (index,), 9 + index, robot=ODD_RATES, outcome=outcome)
    return ExportSource([tmp_path / "crooked-3", tmp_path / "crooked-8"])
