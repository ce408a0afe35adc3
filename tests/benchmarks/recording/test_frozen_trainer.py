import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.recording import frozen_trainer


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Fleets that end at once, and what they were started with."""
    started: list[list[str]] = []

    def start(arguments: list[str], log: Path) -> subprocess.Popen[bytes]:
        started.append(arguments)
        log.write_text("Nothing to say.")
        return subprocess.Popen([sys.executable, "-c", ""])

    monkeypatch.setattr(frozen_trainer, "_readygo", start)
    monkeypatch.setattr(frozen_trainer, "_wait_for", lambda state, process: None)
    spec = type("Spec", (), {"run": "r1"})()
    monkeypatch.setattr(frozen_trainer.RunFolder, "load", lambda self: (spec, 1))
    return started


def test_rate_is_that_between_the_first_and_the_last_report(fleet, monkeypatch, tmp_path: Path) -> None:
    def heard(endpoint: str, run: str, process: subprocess.Popen[bytes]) -> list[tuple[float, int]]:
        process.wait()
        return [(10.0, 100), (11.0, 180), (14.0, 300)]

    monkeypatch.setattr(frozen_trainer, "_heard", heard)
    assert frozen_trainer._samples_hz(["generate", "embedded"], tmp_path, frozen=False) == 50.0
    assert fleet[0][:2] == ["generate", "embedded"]
    assert fleet[0][-2] == "--listen"


def test_run_without_reports_is_told_with_its_log(fleet, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(frozen_trainer, "_heard", lambda endpoint, run, process: (process.wait() and []) or [])
    with pytest.raises(SystemExit, match="Nothing to say"):
        frozen_trainer._samples_hz(["generate", "embedded"], tmp_path, frozen=False)


def test_trainer_that_cannot_start_is_told_with_its_log(fleet, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(frozen_trainer, "JOINS_S", 1.0)
    with (
        pytest.raises(SystemExit, match="Nothing to say"),
        frozen_trainer._frozen_trainer("tcp/127.0.0.1:1", "r1", tmp_path / "data", tmp_path),
    ):
        pass
    assert "--live" in fleet[0]
