from pathlib import Path

import pytest

from readygo.apps.commands.export import ExportOptions, export
from readygo.common.errors import ConfigError, DatasetError


def test_says_what_was_written(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export(ExportOptions(data=(data,), to="gnm", out=tmp_path / "out"))
    assert capsys.readouterr().out == f"3 episodes, 12 rows at 4 Hz in {tmp_path / 'out'} (gnm)\n"
    export(ExportOptions(data=(data,), to="gnm", out=tmp_path / "out"))
    assert "1 parts were there already" in capsys.readouterr().out


def test_data_must_be_named_and_readable(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="Name a data folder"):
        export(ExportOptions(data=(), to="gnm", out=tmp_path / "out"))
    with pytest.raises(DatasetError, match="does not exist"):
        export(ExportOptions(data=(tmp_path / "none",), to="gnm", out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
