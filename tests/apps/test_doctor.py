import importlib.metadata
import importlib.util
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps import doctor
from readygo.apps.doctor import examine


def found(data: Path) -> dict[str, doctor.Finding]:
    return {finding.name: finding for finding in examine(data)}


def test_this_machine_can_work(tmp_path: Path) -> None:
    findings = found(tmp_path / "not" / "there" / "yet")
    assert [name for name, finding in findings.items() if finding.good is False] == []
    assert str(tmp_path) in findings["disk of data"].text
    assert findings["numba"].text == importlib.metadata.version("numba")


def test_full_disk_must_be_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=10**8))
    assert found(tmp_path)["disk of data"].good is False


def test_missing_extra_is_named_with_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    finding = found(tmp_path)["extra train"]
    assert finding.good is None
    assert "pip install" in finding.text


def test_gpu_that_does_not_answer_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: "/bin/false")
    assert found(tmp_path)["GPU"].text == "nvidia-smi is there, but does not answer"
