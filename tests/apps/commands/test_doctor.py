import json
from pathlib import Path

import pytest

from readygo.apps.commands import doctor as command
from readygo.apps.commands.doctor import DoctorOptions, doctor
from readygo.apps.doctor import Finding
from readygo.common.errors import ReadygoError


def test_findings_are_lines_or_json(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    doctor(DoctorOptions(data=tmp_path))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ok   readygo")
    doctor(DoctorOptions(data=tmp_path, json=True))
    assert len(json.loads(capsys.readouterr().out)) == len(lines)


def test_what_must_be_mended_ends_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "examine", lambda data: [Finding("cache", False, "it is read-only")])
    with pytest.raises(ReadygoError, match="mend first: cache"):
        doctor(DoctorOptions())
