from pathlib import Path

import pytest

from readygo.apps.commands.requeue import RequeueOptions, requeue
from readygo.common.errors import RunError
from readygo.runs.recorders import prepare_folders
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder


def test_lost_disk_is_given_up_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    disk = tmp_path / "disk"
    folder = make_folder(
        tmp_path / "data", (DRAW, FILM), wanted=4, recorders=("rec0", "east"), folders={"east": str(disk)}
    )
    prepare_folders(folder, folder.load()[0])
    assert in_process(folder, (DRAW, FILM)).finished
    with pytest.raises(RunError, match="is there"):
        requeue(RequeueOptions(data=folder.path, recorder="east"))
    disk.rename(tmp_path / "gone")
    requeue(RequeueOptions(data=folder.path, recorder="east"))
    assert "Recorder east is given up: its 2 episodes are recorded again" in capsys.readouterr().out


def test_folder_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="holds no recorded run"):
        requeue(RequeueOptions(data=tmp_path, recorder="east"))
    assert list(tmp_path.iterdir()) == []
