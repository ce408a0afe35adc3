from pathlib import Path

import pytest

from readygo.apps.cli import run_command
from readygo.commands import COMMANDS


def test_film_is_written_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "film"
    options = ["--motion", "turn", "--layout", "plain", "--frames", "8", "--size", "64", "64"]
    run_command(COMMANDS, ["avatar", "capture", "gil", "--out", str(out), *options])
    assert {path.name for path in out.iterdir()} == {
        "images", "masks", "cameras.json", "poses.npz", "truth.npz", "truth.json",
    }  # fmt: skip
    assert "8 images of 64x64 px of gil" in capsys.readouterr().out


def test_mistakes_end_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for argv, words in (
        (["gil", "--frames", "2"], "--frames must lie"),
        (["gil", "--body", "keypoints"], "needs --layout plain"),
        (["nobody"], "nobody"),
        (["gil", "--mask-noise-px", "60"], "--mask-noise-px must lie in 0..50, got 60"),
        (["gil", "--walk-radius-m", "5"], "--walk-radius-m must lie in 0.4..3, got 5"),
        (["gil", "--walk-radius-m", "2", "--scene", "embedded"], "walk a smaller circle"),
        (["gil", "--scene", "nowhere"], "nowhere"),
    ):
        with pytest.raises(SystemExit) as stop:
            run_command(COMMANDS, ["avatar", "capture", *argv, "--out", str(tmp_path / "film")])
        assert stop.value.code == 2
        assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
