from pathlib import Path

import pytest

from readygo.apps.commands import recover as command
from readygo.apps.commands.recover import RecoverOptions, recover
from readygo.common.dataset import Dataset
from readygo.common.errors import RunError
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder


def test_folder_that_lost_a_shard_is_said_to_and_recorded_on(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=2)
    assert in_process(folder, (DRAW, FILM)).finished
    (tmp_path / "shard-rec0-00000.mcap").unlink()
    recorded: list[int] = []

    def record(spec: object, out: Path, *, episodes: int, workers: int, show: object) -> dict[str, int]:
        assert (spec, out, episodes, workers) == (folder.load()[0], tmp_path, 2, 3)
        status = in_process(folder, (DRAW, FILM), filmed=recorded)
        return {"episodes": status.committed, "samples": status.samples}

    monkeypatch.setattr(command, "record", record)
    recover(RecoverOptions(data=tmp_path, workers=3))
    assert recorded == [0, 1]
    assert len(Dataset(tmp_path).episodes) == 2
    assert "2 durable episodes are in no sound shard" in caplog.text
    said = capsys.readouterr().err
    assert "holds 2 episodes, 8 samples" in said
    assert "Nothing is lost" not in said


def test_folder_that_lost_nothing_is_said_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_process(make_folder(tmp_path, (DRAW, FILM), wanted=2), (DRAW, FILM))
    monkeypatch.setattr(command, "record", lambda *_, **__: {"episodes": 2, "samples": 8})
    recover(RecoverOptions(data=tmp_path))
    assert "Nothing is lost or damaged.\n" in capsys.readouterr().err


def test_folder_without_a_run_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="holds no recorded run"):
        recover(RecoverOptions(data=tmp_path))
