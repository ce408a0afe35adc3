import shutil
from pathlib import Path

import pytest

from readygo.common.dataset import Dataset, validate
from readygo.common.errors import DatasetError, RunError
from readygo.runs.folder import RunFolder
from readygo.runs.recorders import prepare_folders, requeue
from readygo.runs.recovery import check_recorded, recover
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder


def _run(path: Path, disk: Path, *, wanted: int = 6) -> RunFolder:
    """A run of two recorders, one of them with a disk of its own."""
    folder = make_folder(path, (DRAW, FILM), wanted=wanted, recorders=("rec0", "east"), folders={"east": str(disk)})
    _go_on(folder)
    return folder


def _go_on(folder: RunFolder, filmed: list[int] | None = None) -> None:
    recover(folder)
    prepare_folders(folder, folder.load()[0])
    assert in_process(folder, (DRAW, FILM), filmed).finished
    check_recorded(folder)


def test_dataset_is_on_all_disks_of_its_recorders(tmp_path: Path) -> None:
    folder = _run(tmp_path / "data", tmp_path / "disk")
    assert [len(list(place.glob("shard-*.mcap"))) for place in (folder.path, tmp_path / "disk")] == [1, 1]
    assert [entry.episode.index for entry in Dataset(folder.path).episodes] == [0, 1, 2, 3, 4, 5]
    assert validate(folder.path).episode_count == 6
    again: list[int] = []
    _go_on(folder, again)
    assert again == []


def test_disk_that_is_not_mounted_is_named_and_nothing_is_recorded_twice(tmp_path: Path) -> None:
    folder = _run(tmp_path / "data", tmp_path / "disk")
    (tmp_path / "disk").rename(tmp_path / "unmounted")
    (tmp_path / "disk").mkdir()
    for use in (lambda: recover(folder), lambda: Dataset(folder.path), lambda: validate(folder.path)):
        with pytest.raises(DatasetError, match=r"recorder east, .*disk, is not there: mount its disk, or .*requeue"):
            use()
    (tmp_path / "disk").rmdir()
    (tmp_path / "unmounted").rename(tmp_path / "disk")
    assert recover(folder).lines == []


def test_episodes_of_a_lost_disk_are_recorded_again_and_only_those(tmp_path: Path) -> None:
    folder, disk = _run(tmp_path / "data", tmp_path / "disk"), tmp_path / "disk"
    before = Dataset(folder.path).content_hash
    lost = {entry.episode.index for entry in Dataset(folder.path).episodes if entry.shard.parent == disk}
    disk.rename(tmp_path / "back_later")
    assert requeue(folder, "east") == len(lost) == 3
    filmed: list[int] = []
    _go_on(folder, filmed)
    assert set(filmed) == lost
    (tmp_path / "back_later").rename(disk)
    _go_on(folder, filmed)
    assert Dataset(folder.path).content_hash == before
    assert {entry.shard.parent for entry in Dataset(folder.path).episodes} == {folder.path}


def test_recorder_that_is_given_up_must_have_a_folder_that_is_gone(tmp_path: Path) -> None:
    folder = _run(tmp_path / "data", tmp_path / "disk")
    with pytest.raises(RunError, match=r"is there: `readygo recover"):
        requeue(folder, "east")
    with pytest.raises(RunError, match=r"no recorder 'rec0' with a separate folder \(those that have: east\)"):
        requeue(folder, "rec0")


def test_recorder_on_another_machine_is_given_up_by_its_name(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=4, recorders=("rec0", "far"))
    assert in_process(folder, (DRAW, FILM)).finished
    for shard in folder.path.glob("shard-far-*"):
        shard.unlink()
    folder.elsewhere.touch()
    with pytest.raises(RunError, match=r"has no recorder 'fra'; it has rec0, far"):
        requeue(folder, "fra")
    assert requeue(folder, "far") == 2
    assert recover(folder, recorded_here=False).lines == []
    filmed: list[int] = []
    assert in_process(folder, (DRAW, FILM), filmed).finished
    assert len(filmed) == 2
    assert {entry.shard.name for entry in Dataset(folder.path).episodes} == {
        "shard-rec0-00000.mcap",
        "shard-rec0-00001.mcap",
    }


def test_recorder_on_another_machine_is_not_given_up_while_the_ledger_is_lost(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=4, recorders=("rec0", "far"))
    folder.elsewhere.touch()
    with pytest.raises(RunError, match="is recorded again by `readygo recover"):
        requeue(folder, "far")
    assert not folder.ledger.exists()


def test_run_needs_a_recorder_that_was_not_given_up(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=2, recorders=("east",), folders={"east": str(disk)})
    _go_on(folder)
    shutil.rmtree(disk)
    assert requeue(folder, "east") == 2
    with pytest.raises(RunError, match=r"All recorders of this run were given up \(east\): name another one"):
        _go_on(folder)


@pytest.mark.parametrize("lost", ["ledger*", "ledger*, shards"])
def test_recorder_that_was_given_up_is_not_forgotten_with_the_ledger(lost: str, tmp_path: Path) -> None:
    folder, disk = _run(tmp_path / "data", tmp_path / "disk"), tmp_path / "disk"
    before = Dataset(folder.path).content_hash
    disk.rename(tmp_path / "gone")
    requeue(folder, "east")
    for path in [*folder.state.glob("ledger*"), *(folder.path.glob("shard*") if "shards" in lost else ())]:
        path.unlink()
    _go_on(folder)
    assert not disk.exists()
    assert {entry.shard.parent for entry in Dataset(folder.path).episodes} == {folder.path}
    assert Dataset(folder.path).content_hash == before


def test_ledger_of_an_earlier_day_learns_who_was_given_up_since(tmp_path: Path) -> None:
    folder, disk = _run(tmp_path / "data", tmp_path / "disk"), tmp_path / "disk"
    earlier = folder.ledger.read_bytes()
    disk.rename(tmp_path / "gone")
    requeue(folder, "east")
    folder.ledger.write_bytes(earlier)
    filmed: list[int] = []
    _go_on(folder, filmed)
    assert len(filmed) == 3


def test_what_only_the_ledger_knows_of_those_given_up_is_noted_beside_it(tmp_path: Path) -> None:
    folder, disk = _run(tmp_path / "data", tmp_path / "disk"), tmp_path / "disk"
    disk.rename(tmp_path / "gone")
    requeue(folder, "east")
    folder.retired.unlink()
    recover(folder)
    assert folder.retired.read_text() == "east\n"


@pytest.mark.parametrize("taken", [".readygo-recorder", "shard-east-00000.mcap"])
def test_folder_of_another_recorder_is_refused(taken: str, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / taken).write_text("another run\n")
    with pytest.raises(RunError, match="disk holds shards of another run or recorder"):
        _run(tmp_path / "data", tmp_path / "disk")


def test_recorder_keeps_its_name_only_where_it_has_recorded(tmp_path: Path) -> None:
    path = tmp_path / "data"
    _go_on(make_folder(path, (DRAW, FILM), wanted=1))
    with pytest.raises(RunError, match=r"Recorder rec0 has recorded into .*data itself"):
        _go_on(make_folder(path, (DRAW, FILM), wanted=2, folders={"rec0": str(tmp_path / "disk")}))
