import os
import pickle
from pathlib import Path

import pytest

from readygo.common.dataset.shard_files import ShardFiles


@pytest.fixture
def files(tmp_path: Path) -> ShardFiles:
    """Four files of ten bytes."""
    paths = [tmp_path / str(number) for number in range(4)]
    for number, path in enumerate(paths):
        path.write_bytes(bytes(range(10 * number, 10 * number + 10)))
    return ShardFiles(paths)


def test_bytes_are_those_of_the_shard_at_the_offset(files: ShardFiles) -> None:
    assert [files.read(shard, 3, 2) for shard in (0, 2)] == [bytes([3, 4]), bytes([23, 24])]
    assert files.read(1, 8, 5) == bytes([18, 19])


def test_more_shards_are_read_than_may_be_open(files: ShardFiles, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.common.dataset.shard_files.OPEN_MAX", 2)
    assert [files.read(shard, 0, 1)[0] for shard in (0, 1, 2, 3, 0)] == [0, 10, 20, 30, 0]
    assert len(files._maps) == 2


def test_closed_or_copied_files_are_opened_again(files: ShardFiles) -> None:
    files.read(0, 0, 1)
    copied = pickle.loads(pickle.dumps(files))
    assert (len(files._maps), len(copied._maps)) == (1, 0)
    files.close()
    assert not files._maps
    assert files.read(3, 1, 1) == copied.read(3, 1, 1) == bytes([31])


def test_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "shard-rec0-00000.mcap")
    with pytest.raises(OSError, match="it is a pipe or a device"):
        ShardFiles([tmp_path / "shard-rec0-00000.mcap"]).read(0, 0, 1)
