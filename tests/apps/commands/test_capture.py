from pathlib import Path

import pytest

from readygo.apps.cli import run_command
from readygo.commands import COMMANDS


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--out", "walk.mp4"], "Give either --walk"),
        (["--walk", "--photos", "--out", "walk.mp4"], "Give either --walk"),
        (["--walk", "--out", "walk.avi"], "must end in"),
        (["--walk", "--out", "walk.mp4", "--marker-dictionary", "9X9"], "no marker dictionary"),
        (["--walk", "--out", "walk.mp4", "--seconds", "0"], "2 s at least"),
        (["--walk", "--out", "walk.mp4", "--people", "9"], "0 to 8 people"),
        (["--photos", "--people", "1", "--out", "."], ". must be the name of a new folder"),
        (["--walk", "--people", "1", "--out", "."], "must end in"),
    ],
)
def test_mistakes_end_in_one_line(
    argv: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["scene", "capture", "embedded", *argv])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_photos_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "photos"
    options = ["--seconds", "2", "--fps", "1", "--size", "64", "48", "--radius", "2.5"]
    run_command(COMMANDS, ["scene", "capture", "embedded", "--photos", "--out", str(out), *options])
    assert len(list(out.iterdir())) == 2
    assert (tmp_path / "photos.truth.json").is_file()
    printed = capsys.readouterr()
    assert "2 pictures of 64x48 px" in printed.out
    assert "filming" not in printed.err, "no bar is left behind"
