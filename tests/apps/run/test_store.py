import json
from pathlib import Path

import pytest

from readygo.apps.run.folder import RunFolder
from readygo.apps.run.recovery import recover
from readygo.apps.run.store import LIST, hand_over
from readygo.common.dataset import Dataset, ShardWriter
from readygo.common.dataset.index import index_path, load_index
from readygo.common.dataset.stage import Stage
from readygo.common.errors import RunError
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder
from tests.common.dataset.forge import chunks_of

fsspec = pytest.importorskip("fsspec", reason="the extra store is not installed")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=4, recorders=("rec0", "rec1"))
    assert in_process(folder, (DRAW, FILM)).finished
    Dataset(folder.path)
    return folder.path


def test_shards_are_copied_once_and_open_where_they_are(data: Path, tmp_path: Path) -> None:
    url, told = str(tmp_path / "bucket" / "lobby"), []
    assert hand_over(data, url, told=lambda name, done: told.append((name, done))) == 4
    assert hand_over(data, url, told=lambda name, done: told.append((name, done))) == 0
    assert [done for _, done in told] == ["copied"] * 4 + ["is there"] * 4
    assert Dataset(url).content_hash == Dataset(data).content_hash
    listed = json.loads(Path(url, LIST).read_text())
    assert {name: entry["size"] for name, entry in listed.items()} == {
        path.name: path.stat().st_size for path in data.glob("shard-*")
    }


def test_other_kinds_of_stores_are_named_by_their_url(data: Path) -> None:
    assert hand_over(data, "memory://bucket/lobby") == 4
    assert fsspec.filesystem("memory").exists("/bucket/lobby/shards.json")
    with pytest.raises(RunError, match=r"The store nowhere://x cannot be used: Protocol not known: nowhere"):
        hand_over(data, "nowhere://x")


def test_file_that_was_cut_off_or_changed_in_the_store_is_copied_again(data: Path, tmp_path: Path) -> None:
    bucket = tmp_path / "bucket"
    hand_over(data, str(bucket))
    first, second = sorted(bucket.glob("*.mcap"))
    first.write_bytes(first.read_bytes()[:-1])
    second.write_bytes(second.read_bytes()[:-1] + b"x")
    assert hand_over(data, str(bucket)) == 1
    assert hand_over(data, str(bucket), every_byte=True) == 1
    assert Dataset(bucket).content_hash == Dataset(data).content_hash


def _record_second_episode_twice(data: Path) -> None:
    """Another recorder has an episode as well, in a shard that is the last by name."""
    first = min(data.glob("shard-*.mcap"))
    provenance = load_index(first).provenance
    with ShardWriter(data / "shard-west-00000.mcap", provenance, stage=Stage(), fsync=False) as writer:
        writer.append(chunks_of(first)[1])


def test_shard_that_recovery_dropped_leaves_the_store(data: Path, tmp_path: Path) -> None:
    bucket, told = tmp_path / "bucket", []
    _record_second_episode_twice(data)
    hand_over(data, str(bucket))
    assert (bucket / "shard-west-00000.mcap").exists()
    recover(RunFolder(data))
    hand_over(data, str(bucket), told=lambda name, done: told.append((name, done)))
    assert told[-1] == ("shard-west-00000.mcap", "removed: its episodes are in other shards")
    assert {path.name for path in bucket.glob("shard-*")} == {path.name for path in data.glob("shard-*")}
    assert set(json.loads(Path(bucket, LIST).read_text())) == {path.name for path in data.glob("shard-*")}
    assert Dataset(bucket).content_hash == Dataset(data).content_hash


@pytest.mark.parametrize("with_index", [True, False])
def test_shard_whose_episodes_are_nowhere_else_stays_in_the_store(data: Path, tmp_path: Path, with_index: bool) -> None:
    bucket = tmp_path / "bucket"
    hand_over(data, str(bucket))
    first = min(data.glob("shard-*.mcap"))
    first.unlink()
    if not with_index:
        index_path(bucket / first.name).unlink()
    hand_over(data, str(bucket))
    assert first.name in json.loads(Path(bucket, LIST).read_text())
    assert (bucket / first.name).exists()


def test_store_that_gives_back_something_else_is_told(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fsspec.implementations.local import LocalFileSystem

    def put(self: LocalFileSystem, source: str, place: str) -> None:
        Path(place).write_bytes(Path(source).read_bytes()[1:])

    monkeypatch.setattr(LocalFileSystem, "put_file", put)
    with pytest.raises(RunError, match="is not what was written"):
        hand_over(data, str(tmp_path / "bucket"))
    assert not (tmp_path / "bucket" / LIST).exists()
