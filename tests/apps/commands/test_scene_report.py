import json
from pathlib import Path

import pytest

from readygo.apps.cli import run_command
from readygo.commands import COMMANDS
from tests.apps.report.scenes import reconstructed


def test_report_of_a_reconstructed_room_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = reconstructed(tmp_path / "room")
    run_command(COMMANDS, ["scene", "report", str(scene.path), "--out", str(tmp_path / "out")])
    assert "report.html" in capsys.readouterr().out
    numbers = json.loads((tmp_path / "out" / "report.json").read_text())
    assert numbers["held_out"]["psnr_db"] == 25.5
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count("<img ") == 7


@pytest.mark.parametrize(
    ("argv", "words"), [(["nothing"], "does not exist"), (["embedded", "--radius", "0"], "--radius must be positive")]
)
def test_mistakes_end_in_one_line(argv: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["scene", "report", *argv])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
