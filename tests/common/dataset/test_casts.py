"""Who takes part in recorded episodes."""

import pytest

from readygo.common.dataset.casts import read_casts
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import write_shard


def test_casts_come_in_the_order_of_the_shard(tmp_path) -> None:
    shard = write_shard(tmp_path, [4, 2], avatars=("ann", "bob"), encounters=("crossing", "parallel"))
    casts = read_casts(shard)
    assert [cast.episode.index for cast in casts] == [4, 2]
    assert casts[0].avatars == ("ann", "bob")
    assert casts[0].encounters == ("crossing", "parallel")


def test_episode_without_humans_has_an_empty_cast(tmp_path) -> None:
    (cast,) = read_casts(write_shard(tmp_path, [0], avatars=(), encounters=()))
    assert cast.avatars == cast.encounters == ()


def test_truncated_shard_is_named(tmp_path) -> None:
    shard = write_shard(tmp_path, [0])
    shard.write_bytes(shard.read_bytes()[:-100])
    with pytest.raises(DatasetError, match=r"shard-r0-00000\.mcap cannot be read: .*readygo validate"):
        read_casts(shard)
