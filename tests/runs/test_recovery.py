import errno
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from readygo.common.dataset import Dataset, ShardWriter, validate
from readygo.common.dataset.committed import episode_indices
from readygo.common.dataset.index import load_index
from readygo.common.dataset.places import MARK, note_folders
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import DiskError, RunError
from readygo.runs import recovery
from readygo.runs.folder import RunFolder
from readygo.runs.recovery import Findings, Witness, check_recorded, recover
from readygo.services.coordinator import Ledger
from readygo.services.recorder import RecorderConfig
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder
from tests.common.dataset.forge import chunks_of

LINE = (DRAW, FILM)
EPISODES = 6


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A finished run of six episodes in three shards, and the hash of what it holds."""
    folder = make_folder(
        tmp_path_factory.mktemp("run"),
        LINE,
        wanted=EPISODES,
        recorder=RecorderConfig(episodes_per_shard=2, fsync=False),
    )
    assert in_process(folder, LINE).finished
    return folder.path, Dataset(folder.path).content_hash


@pytest.fixture
def folder(recorded: tuple[Path, str], tmp_path: Path) -> RunFolder:
    return RunFolder(Path(shutil.copytree(recorded[0], tmp_path / "data")))


def _shard(folder: RunFolder, number: int = 1) -> Path:
    return folder.path / f"shard-rec0-{number:05d}.mcap"


def _second_episode(shard: Path) -> int:
    """A byte of an image of a shard's second episode."""
    return int(load_index(shard).samples["image_offset"][5]) + 20


def _flip_byte(shard: Path) -> None:
    data = bytearray(shard.read_bytes())
    data[_second_episode(shard)] ^= 1
    shard.write_bytes(data)


def _lose_ledger(folder: RunFolder) -> None:
    for path in folder.state.glob("ledger*"):
        path.unlink()


def _damage_ledger(folder: RunFolder) -> None:
    _lose_ledger(folder)
    folder.ledger.write_bytes(b"no ledger at all " * 500)


def _lose_shard(folder: RunFolder) -> None:
    _shard(folder).unlink()


def _damage_shard(folder: RunFolder) -> None:
    _flip_byte(_shard(folder))


def _cut_shard(folder: RunFolder) -> None:
    shard = _shard(folder)
    shard.write_bytes(shard.read_bytes()[: _second_episode(shard)])


def _lose_ledger_and_damage_shard(folder: RunFolder) -> None:
    _lose_ledger(folder)
    _damage_shard(folder)


def _lose_episode(folder: RunFolder) -> None:
    """The shard is another one than the ledger says."""
    shutil.copy(_shard(folder, 0), _shard(folder, 1))
    _shard(folder).with_suffix(".index").unlink()
    _shard(folder, 0).unlink()


def _copy_shard(folder: RunFolder) -> None:
    shutil.copy(_shard(folder, 1), _shard(folder, 7))


def _record_twice(folder: RunFolder, recorder: str = "east") -> None:
    """Another recorder has the second episode of a shard as well, and the first one of the next."""
    chunks = [*chunks_of(_shard(folder, 0))[1:], *chunks_of(_shard(folder, 1))[:1]]
    provenance = load_index(_shard(folder)).provenance
    with ShardWriter(folder.path / f"shard-{recorder}-00000.mcap", provenance, stage=Scenery(), fsync=False) as writer:
        for chunk in chunks:
            writer.append(chunk)


def _lose_ledger_and_record_twice(folder: RunFolder) -> None:
    _lose_ledger(folder)
    _record_twice(folder, "west")


DAMAGES = {
    _lose_ledger: 0,
    _damage_ledger: 0,
    _lose_shard: 2,
    _damage_shard: 1,
    _cut_shard: 1,
    _lose_ledger_and_damage_shard: 1,
    _lose_episode: 2,
    _copy_shard: 0,
    _record_twice: 0,
    _lose_ledger_and_record_twice: 0,
}
"""What is done to a run, and how many episodes it must record again for it."""


@pytest.mark.parametrize(("damage", "again"), DAMAGES.items(), ids=lambda value: getattr(value, "__name__", ""))
def test_run_is_whole_again_whatever_was_lost(
    recorded: tuple[Path, str], folder: RunFolder, damage: Callable[[RunFolder], None], again: int
) -> None:
    damage(folder)
    findings = recover(folder)
    assert findings.lines
    filmed: list[int] = []
    status = in_process(folder, LINE, filmed=filmed)
    assert (status.finished, status.committed) == (True, EPISODES)
    assert len(filmed) == again
    assert validate(folder.path).ok
    assert Dataset(folder.path).content_hash == recorded[1]
    assert recover(folder).lines == []
    check_recorded(folder)


def _indices(folder: RunFolder) -> dict[str, list[int]]:
    """Indices of the episodes by shard."""
    return {shard.name: [int(i) for i in load_index(shard).episodes["index"]] for shard in folder.path.glob("*.mcap")}


def test_first_shard_by_name_keeps_its_copies_and_the_others_their_other_episodes(folder: RunFolder) -> None:
    _record_twice(folder)
    _copy_shard(folder)
    lines = recover(folder).lines
    assert _indices(folder) == {
        "shard-east-00000.mcap": [1, 2],
        "shard-rec0-00000.mcap": [0],
        "shard-rec0-00001.mcap": [3],
        "shard-rec0-00002.mcap": [4, 5],
    }
    assert [line.split(" that")[0] for line in lines] == [
        "shard-rec0-00000.mcap had 1 episodes",
        "shard-rec0-00001.mcap had 1 episodes",
        "shard-rec0-00007.mcap had 2 episodes",
    ]
    assert not _shard(folder, 7).with_suffix(".index").exists()


def test_copy_that_lies_where_its_recorder_does_not_write_is_the_one_that_goes(
    folder: RunFolder, tmp_path: Path
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    (disk / MARK).touch()
    for number in range(3):
        shutil.copy(_shard(folder, number), disk)
    note_folders(folder.path, {"rec0": disk})
    recover(folder)
    assert _indices(folder) == {}
    assert len(Dataset(folder.path).episodes) == EPISODES


class _Killed(BaseException):
    """Ends everything at once."""


@pytest.mark.parametrize("step", range(4))
def test_recovery_that_is_killed_at_a_double_loses_nothing(
    recorded: tuple[Path, str], folder: RunFolder, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _record_twice(folder)
    steps = 0

    class Dying(ShardWriter):
        def append(self, *args: Any, **how: Any) -> None:
            _die_at(step)
            super().append(*args, **how)

        def close(self) -> Path | None:
            _die_at(step)
            return super().close()

    def _die_at(number: int) -> None:
        nonlocal steps
        steps += 1
        if steps > number:
            raise _Killed

    with monkeypatch.context() as patched:
        patched.setattr("readygo.services.recorder.salvage.ShardWriter", Dying)
        with pytest.raises(_Killed):
            recover(folder)
    assert {defect.kind for defect in validate(folder.path).defects} == {"duplicate"}
    recover(folder)
    assert validate(folder.path).ok
    assert Dataset(folder.path).content_hash == recorded[1]


def test_double_that_the_disk_does_not_let_go_is_said_in_one_line(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    _record_twice(folder)

    def full(*args: object, **how: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(ShardWriter, "append", full)
    with pytest.raises(RunError, match=r"shard-rec0-00000\.mcap cannot be written .*: No space left on device"):
        recover(folder)


def test_sound_run_is_left_alone_and_its_shards_are_read_once(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert recover(folder).lines == []
    monkeypatch.setattr("readygo.runs.recovery._check_bytes", lambda shard: pytest.fail("it was read before"))
    assert recover(folder).lines == []
    with pytest.raises(pytest.fail.Exception):
        recover(folder, every_byte=True)


def test_run_without_data_has_nothing_to_recover(tmp_path: Path) -> None:
    assert recover(RunFolder(tmp_path)).lines == []


@pytest.mark.parametrize("damage", [_lose_shard, _damage_shard])
def test_episode_that_cannot_be_read_is_said_at_the_end(folder: RunFolder, damage: Callable[[RunFolder], None]) -> None:
    check_recorded(folder)
    damage(folder)
    with pytest.raises(RunError, match=r"2 recorded episodes of .* cannot be read .*`readygo recover"):
        check_recorded(folder)


def test_crash_is_recovered_from_as_ever(folder: RunFolder) -> None:
    """A shard that was being written: its recorder tells what is in it."""
    _shard(folder, 2).rename(_shard(folder, 2).with_suffix(".mcap.part"))
    assert recover(folder).lines == []
    filmed: list[int] = []
    assert in_process(folder, LINE, filmed=filmed).finished
    assert filmed == []
    assert validate(folder.path).ok


def test_episode_is_found_where_its_recorder_says_or_in_what_it_writes(folder: RunFolder) -> None:
    name, witness = _shard(folder).name, Witness(folder)
    assert witness.holds_episode("rec0", name, 2)
    assert not witness.holds_episode("rec0", name, 0)
    assert not witness.holds_episode("rec0", "../" * 9 + "etc/passwd", 2)
    _shard(folder).rename(_shard(folder, 9).with_suffix(".mcap.part"))
    assert witness.holds_episode("rec0", name, 2)
    assert not witness.holds_episode("rec0", "../" * 9 + "etc/passwd", 2)
    assert not witness.holds_episode("rec1", name, 2)


def test_shard_that_grows_is_read_on_from_where_it_ended(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    shard = _shard(folder)
    whole, (_, end), *rest = shard.read_bytes(), *episode_indices(shard)
    assert rest
    begins: list[int] = []

    def read(path: Path, begin: int = 0) -> Iterator[tuple[int, int]]:
        begins.append(begin)
        return episode_indices(path, begin)

    monkeypatch.setattr(recovery, "episode_indices", read)
    witness, last = Witness(folder), rest[-1][0]
    shard.write_bytes(whole[:end])
    assert not witness.holds_episode("rec0", shard.name, last)
    shard.write_bytes(whole)
    assert witness.holds_episode("rec0", shard.name, last)
    assert begins == [0, end]
    shard.write_bytes(whole[: end // 2])
    assert not witness.holds_episode("rec0", shard.name, last)
    assert begins[2:] == [0]


def test_ledger_of_an_earlier_day_learns_what_was_recorded_since(folder: RunFolder) -> None:
    with sqlite3.connect(folder.ledger) as ledger:
        ledger.execute("UPDATE episode SET state = 'waiting', stage = 'draw' WHERE idx > 1")
    ledger.close()
    assert recover(folder).rebuilt is False
    filmed: list[int] = []
    assert in_process(folder, LINE, filmed=filmed).finished
    assert filmed == []


def test_shards_that_are_on_other_machines_are_not_missed(folder: RunFolder) -> None:
    for shard in folder.path.glob("shard-*"):
        shard.unlink()
    assert recover(folder, recorded_here=False) == recovery.Findings()
    assert len(recover(folder).lost) == EPISODES


def test_shards_of_a_recorder_here_are_brought_in_line_wherever_the_others_are(folder: RunFolder) -> None:
    _lose_shard(folder)
    assert recover(folder, recorded_here=False).lost == [2, 3]


@pytest.mark.parametrize("damage", [_lose_ledger, _damage_ledger])
def test_ledger_is_not_made_anew_without_the_shards_of_other_machines(
    damage: Callable[[RunFolder], None], folder: RunFolder
) -> None:
    damage(folder)
    with pytest.raises(RunError, match=r"gather their shards in .*, and run `readygo recover"):
        recover(folder, recorded_here=False)
    assert recover(folder).rebuilt
    assert recover(folder, recorded_here=False) == recovery.Findings()


def test_run_whose_recorders_are_on_other_machines_is_left_to_its_coordinator(folder: RunFolder) -> None:
    folder.elsewhere.touch()
    with pytest.raises(RunError, match=r"on other machines: `readygo coordinator .* resumes the run, after `readygo r"):
        recover(folder)


@pytest.mark.parametrize("damage", [_lose_ledger, _damage_ledger])
def test_lost_ledger_of_recorders_on_other_machines_is_rebuilt_from_the_shards_that_were_gathered(
    damage: Callable[[RunFolder], None], folder: RunFolder, recorded: tuple[Path, str], tmp_path: Path
) -> None:
    folder.elsewhere.touch()
    damage(folder)
    away = tmp_path / "away"
    away.mkdir()
    for shard in folder.path.glob("shard-*"):
        shard.rename(away / shard.name)
    for recorded_here in (True, False):
        with pytest.raises(RunError, match=r"gather their shards in .*, and run `readygo recover"):
            recover(folder, recorded_here=recorded_here)
    for shard in away.iterdir():
        shard.rename(folder.path / shard.name)
    assert recover(folder).rebuilt
    filmed: list[int] = []
    assert in_process(folder, LINE, filmed=filmed).finished
    assert filmed == []
    assert recover(folder) == recovery.Findings()
    assert Dataset(folder.path).content_hash == recorded[1]


def _start_on_a_full_disk(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lose the ledger, and have a start get no further than to make an empty one."""
    _lose_ledger(folder)
    Ledger(folder.ledger).close()


def _end_while_it_is_made_anew(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    _lose_ledger(folder)
    with monkeypatch.context() as context:
        context.setattr(Ledger, "fill_gaps", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            recover(folder)


@pytest.mark.parametrize("interrupted", [_start_on_a_full_disk, _end_while_it_is_made_anew])
def test_ledger_that_is_half_made_anew_is_made_to_its_end(
    interrupted: Callable[[RunFolder, pytest.MonkeyPatch], None],
    folder: RunFolder,
    recorded: tuple[Path, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _lose_shard(folder)
    interrupted(folder, monkeypatch)
    with pytest.raises(RunError, match="gather their shards"):
        recover(folder, recorded_here=False)
    assert recover(folder).rebuilt
    assert in_process(folder, LINE).finished
    assert Dataset(folder.path).content_hash == recorded[1]
    assert recover(folder) == recovery.Findings()


def test_ledger_that_cannot_be_used_for_now_is_not_damaged(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as context:
        context.setattr(Ledger, "check", Mock(side_effect=DiskError("The disk is full.")))
        with pytest.raises(DiskError, match="full"):
            recover(folder)
    assert recover(folder) == recovery.Findings()
    assert not list(folder.state.glob("damaged-*"))


def test_findings_are_told_one_a_line() -> None:
    assert Findings().lines == []
    found = Findings(rebuilt=True, damaged={Path("d/a.mcap"): "cut"}, doubles={Path("d/b.mcap"): 3}, lost=[4, 9])
    assert found.lines == [
        "The run's ledger was lost or damaged: it is rebuilt from the shards.",
        "a.mcap is damaged (cut): what is whole in it is saved.",
        "b.mcap had 3 episodes that are in other shards as well: they are dropped from it.",
        "2 durable episodes are in no sound shard: what cannot be saved is recorded again.",
    ]
