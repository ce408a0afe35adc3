from pathlib import Path
from typing import Any

import pytest

from readygo.apps.cli import run_command
from readygo.apps.commands import reconstruct
from readygo.commands import COMMANDS
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.reconstruct import Job
from readygo.services.reconstructor.stages import Say


def test_marker_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "marker.pdf"
    run_command(COMMANDS, ["marker", "--size-m", "0.2", "--out", str(out)])
    assert out.read_bytes().startswith(b"%PDF-1.4")
    assert "0.2 m wide" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["marker", "--size-m", "2", "--out", "m.pdf"], "A3"),
        (["scene", "poses", "no.mp4", "--scale", "-1", "--out", "out"], "scale must be at least 0"),
        (["scene", "poses", "no.mp4", "--out", "out"], "Nothing tells the scale"),
    ],
)
def test_mistakes_end_in_one_line(
    argv: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, argv)
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("kept", "words"), [(True, "finished stages stay in"), (False, "no stage is finished yet")])
def test_ctrl_c_names_the_work_folder_where_something_of_it_is_there(
    kept: bool, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, Any]:
        if kept:
            job.work.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(reconstruct, "reconstruct", interrupted)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["reconstruct", "walk.mp4", "--scale", "1", "--out", str(tmp_path / "lobby")])
    assert stop.value.code == 130
    said = capsys.readouterr().err
    assert words in said
    assert ("lobby.work" in said) == kept
