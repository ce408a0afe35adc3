import pytest

from readygo.common.dataset import Dataset
from readygo.common.dataset.entries import episode_order
from readygo.common.dataset.index import load_index
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import write_shard


def test_episodes_come_in_order_of_their_index(two_shards) -> None:
    dataset = Dataset([two_shards])
    entries = dataset.episodes
    assert [(entry.episode.index, entry.first_sample, entry.sample_count) for entry in entries] == [
        (0, 0, 12),
        (2, 12, 30),
        (4, 42, 12),
    ]
    assert [entry.shard.name for entry in entries] == [f"shard-r0-0000{number}.mcap" for number in (0, 1, 0)]
    assert len(dataset) == 54


def test_folder_given_twice_is_refused(two_shards) -> None:
    with pytest.raises(DatasetError, match="train-7-000000 is there twice"):
        Dataset([two_shards, two_shards])


def test_episodes_of_a_folder_stay_together(tmp_path) -> None:
    first = load_index(write_shard(tmp_path / "first", [4, 0]))
    second = load_index(write_shard(tmp_path / "second", [2]))
    assert episode_order([0, 1], [first, second]) == [(0, 1), (0, 0), (1, 0)]
    assert episode_order([0, 0], [first, second]) == [(0, 1), (1, 0), (0, 0)]
    assert episode_order([1, 0], [first, second]) == [(1, 0), (0, 1), (0, 0)]
