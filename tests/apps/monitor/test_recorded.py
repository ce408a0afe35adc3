from pathlib import Path

import pytest

from readygo.apps.monitor.recorded import TRACKS_MAX, Recorded
from readygo.common.dataset.places import MARK, NOTE, note_folders
from readygo.common.errors import DatasetError
from readygo.common.messages import EpisodeKey, Outcome, Split
from tests.common.dataset.episodes import write_shard


def test_episodes_of_finished_and_open_shards_are_listed_and_read(data: Path) -> None:
    (shard,) = data.glob("shard-*.mcap")
    finished = Recorded(data)
    keys = list(finished.episodes())
    assert [key.index for key in keys] == [0, 1, 2]
    cut = shard.read_bytes()
    shard.with_suffix(".index").unlink(missing_ok=True)
    shard.unlink()
    shard.with_name(f"{shard.name}.part").write_bytes(cut[:-2000])
    being_written = Recorded(data)
    assert list(being_written.episodes())[:2] == keys[:2]
    track = being_written.track(keys[1])
    assert track is not None
    assert (track.episode, len(track.states), track.outcome) == (keys[1], 20, Outcome.SUCCESS)
    assert len(track.images) == 20


def test_shards_on_the_disks_of_recorders_are_shown_while_they_are_there(data: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    write_shard(disk, [7])
    write_shard(data, [8])
    recorded = Recorded(data)
    note_folders(data, {"r1": disk})
    assert [key.index for key in recorded.episodes()] == [8]
    assert "The folder of recorder r1" in recorded.absent
    (disk / MARK).touch()
    keys = list(recorded.episodes())
    assert [key.index for key in keys] == [7, 8]
    assert recorded.absent == ""
    track = recorded.track(keys[0])
    assert track is not None
    assert track.episode == keys[0]
    (shard,) = disk.glob("shard-*.mcap")
    shard.with_suffix(".index").unlink(missing_ok=True)
    shard.rename(shard.with_name(f"{shard.name}.part"))
    growing = Recorded(data)
    assert list(growing.episodes()) == keys
    (data / NOTE).write_text("{")
    assert [key.index for key in growing.episodes()] == [8]
    assert "cannot be read" in growing.absent


def test_reading_changes_nothing_and_keeps_few(data: Path) -> None:
    before = {path.name: path.read_bytes() for path in data.iterdir()}
    recorded = Recorded(data)
    for key in recorded.episodes():
        assert recorded.track(key) is recorded.track(key)
    assert {path.name: path.read_bytes() for path in data.iterdir()} == before
    assert len(recorded._tracks) <= TRACKS_MAX
    assert recorded.track(EpisodeKey(seed=99, split=Split.VAL, index=0)) is None


def test_damaged_shard_is_named(data: Path) -> None:
    (shard,) = data.glob("shard-*.mcap")
    whole = bytearray(shard.read_bytes())
    whole[len(whole) // 2] ^= 255
    shard.write_bytes(whole)
    recorded = Recorded(data)
    with pytest.raises(DatasetError, match=r"shard-.*cannot be read"):
        [recorded.track(key) for key in recorded.episodes()]
