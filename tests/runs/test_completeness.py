import json
import shutil
from pathlib import Path

import pytest

from readygo.apps.commands.data import ValidateOptions, validate
from readygo.common.errors import DatasetError
from readygo.runs.completeness import check_completeness
from readygo.runs.folder import RunFolder
from readygo.services.recorder import RecorderConfig
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder

LINE = (DRAW, FILM)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of six episodes in three shards."""
    config = RecorderConfig(episodes_per_shard=2, fsync=False)
    folder = make_folder(tmp_path_factory.mktemp("run"), LINE, wanted=6, recorder=config)
    assert in_process(folder, LINE).finished
    return folder.path


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> RunFolder:
    return RunFolder(Path(shutil.copytree(recorded, tmp_path / "data")))


def _lose_shard(folder: RunFolder, number: int) -> None:
    for file in folder.path.glob(f"shard-rec0-{number:05d}.mcap*"):
        file.unlink()


def test_whole_run_lacks_nothing(folder: RunFolder) -> None:
    assert check_completeness(folder.path) == ([], [])


def test_shard_that_is_gone_is_a_defect_with_its_episodes(folder: RunFolder) -> None:
    _lose_shard(folder, 1)
    (defect,), notes = check_completeness(folder.path)
    assert str(defect) == "shard-rec0-00001.mcap: missing: 2 of its durable episodes are in no shard: 2-3"
    assert notes == []


def test_validate_names_what_is_missing_and_fails(folder: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    _lose_shard(folder, 0)
    _lose_shard(folder, 2)
    with pytest.raises(DatasetError, match=r"has 2 defects in 2 episodes, .*run the same `readygo generate` again"):
        validate(ValidateOptions(data=folder.path, json=True))
    report = json.loads(capsys.readouterr().out)
    assert not report["ok"]
    assert [defect["text"].rpartition(": ")[2] for defect in report["defects"]] == ["0-1", "4-5"]


def test_episode_that_another_shard_holds_is_not_missing(folder: RunFolder) -> None:
    shard = folder.path / "shard-rec0-00001.mcap"
    shard.rename(folder.path / "shard-rec0-00009.mcap")
    shard.with_name(shard.name + ".index").unlink(missing_ok=True)
    assert check_completeness(folder.path) == ([], [])


def test_episode_of_an_open_shard_is_not_missing(folder: RunFolder) -> None:
    shard = folder.path / "shard-rec0-00001.mcap"
    shard.rename(shard.with_name(f"{shard.name}.part"))
    _lose_shard(folder, 0)
    (defect,), _ = check_completeness(folder.path)
    assert defect.shard == "shard-rec0-00000.mcap"


def test_run_that_is_not_over_is_no_defect(folder: RunFolder) -> None:
    spec, _ = folder.load()
    folder.save(spec, 10)
    words = "The run is not over: 6 of 10 wanted episodes are recorded."
    assert check_completeness(folder.path) == ([], [words])


def test_folder_without_its_ledger_is_compared_with_what_is_wanted(folder: RunFolder) -> None:
    for file in folder.state.glob("ledger*"):
        file.unlink()
    assert check_completeness(folder.path) == ([], [])
    _lose_shard(folder, 1)
    (defect,), _ = check_completeness(folder.path)
    assert "the run's ledger is gone, and 4 of 6 wanted episodes are here" in str(defect)


def test_shards_of_recorders_on_other_machines_are_noted(folder: RunFolder) -> None:
    folder.elsewhere.touch()
    for number in range(3):
        _lose_shard(folder, number)
    defects, notes = check_completeness(folder.path)
    assert defects == []
    assert notes[0] == (
        "shard-rec0-00000.mcap is on the machine of its recorder: 2 of its durable episodes are in no shard: 0-1."
    )


@pytest.mark.parametrize("damaged", ["ledger.sqlite", "spec.msgpack", "wanted"])
def test_state_that_is_damaged_is_noted(damaged: str, folder: RunFolder) -> None:
    for file in folder.state.glob(f"{damaged}*"):
        file.write_bytes(b"no such thing at all " * 300)
    defects, notes = check_completeness(folder.path)
    assert defects == []
    assert [note.startswith("Whether episodes are missing is not known: ") for note in notes] == [True]


def test_shards_alone_can_be_any_part_of_a_run(folder: RunFolder) -> None:
    shutil.rmtree(folder.state)
    _lose_shard(folder, 1)
    assert check_completeness(folder.path) == ([], [])
