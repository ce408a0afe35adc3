"""`readygo scene train` as users call it."""

from pathlib import Path

import pytest

from readygo.apps.cli import run_command
from readygo.commands import COMMANDS


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["scene", "train", "nowhere", "--out", "out"], "nowhere needs images/ and a COLMAP model"),
        (["scene", "train", "nowhere", "--out", "out", "--steps", "0"], "steps must be at least 1"),
        (["scene", "train", "nowhere", "--out", "out", "--gaussians", "5"], "count_max must be at least 100"),
        (["scene", "train", "nowhere", "--out", "out", "--device", "tpu"], "tpu"),
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
    assert not (tmp_path / "out" / "gaussians.ply").exists()
