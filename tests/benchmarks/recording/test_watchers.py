import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.recording import watchers


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run whose name is known."""
    spec = type("Spec", (), {"run": "r1"})()
    monkeypatch.setattr(watchers.RunFolder, "load", lambda self: (spec, 1))


def started(monkeypatch: pytest.MonkeyPatch, work: str) -> list[list[str]]:
    """What is started from now on; in place of everything, a process does `work`."""
    commands: list[list[str]] = []
    popen = subprocess.Popen

    def start(command: list[str], **options: object) -> "subprocess.Popen[bytes]":
        commands.append(command)
        return popen([sys.executable, "-c", work], **options)  # type: ignore[call-overload, no-any-return]

    monkeypatch.setattr(watchers.subprocess, "Popen", start)
    return commands


def test_time_is_that_of_the_fleet_and_its_processes(
    run: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    work = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {busy!r}])"
    commands = started(monkeypatch, work)
    assert watchers._cpu_s(["generate", "embedded"], tmp_path, 0) >= 0.3
    assert commands[0][3:5] == ["generate", "embedded"]


def test_watchers_end_with_the_run(run: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    commands = started(monkeypatch, "")
    watchers._cpu_s(["generate", "embedded"], tmp_path, 2)
    assert [command[1] for command in commands] == ["-m", "-c", "-c"]
    assert commands[1][-2:] == ["r1", watchers.TOKEN]


def test_fleet_that_fails_is_told_with_its_log(run: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started(monkeypatch, "print('Nothing to say.'); raise SystemExit(2)")
    with pytest.raises(SystemExit, match="Nothing to say"):
        watchers._cpu_s(["generate", "embedded"], tmp_path, 0)
