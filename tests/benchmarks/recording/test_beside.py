import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.recording import beside

BUSY = "import time\nwhile time.process_time() < 0.3: pass"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """What is started; in place of a fleet a busy child of a process, in place of all others one that waits."""
    commands: list[list[str]] = []

    def start(command: list[str], log: Path) -> subprocess.Popen[bytes]:
        commands.append(command)
        log.write_text("Nothing to say.")
        work = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BUSY!r}])"
        return subprocess.Popen(
            [sys.executable, "-c", work if "generate" in command else "import time; time.sleep(60)"]
        )

    monkeypatch.setattr(beside, "_start", start)
    monkeypatch.setattr(beside, "JOINS_S", 0.0)
    spec = type("Spec", (), {"run": "r1"})()
    monkeypatch.setattr(beside.RunFolder, "load", lambda self: (spec, 1))
    return commands


def heard(endpoint: str, data: Path, fleet: subprocess.Popen[bytes]) -> list[tuple[float, int]]:
    fleet.wait()
    return [(10.0, 100), (11.0, 180), (14.0, 300)]


@pytest.mark.parametrize("kind", beside.KINDS)
def test_rate_and_time_are_those_of_the_fleet_and_all_end_with_it(
    kind: str, started: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(beside, "_heard", heard)
    samples_hz, cpu_s = beside.measure(["generate", "embedded"], tmp_path, kind, 2)
    assert samples_hz == 50.0
    assert cpu_s >= 0.3
    others = {beside.ALONE: 0, beside.FROZEN_TRAINER: 1}.get(kind, 2)
    assert len(started) == 1 + others
    assert started[0][3] == "generate"


def test_run_without_reports_is_told_with_its_log(
    started: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(beside, "_heard", lambda endpoint, data, fleet: [] if fleet.wait() == 0 else [(0.0, 0)])
    with pytest.raises(SystemExit, match="Nothing to say"):
        beside.measure(["generate", "embedded"], tmp_path, beside.ALONE, 0)


def test_medians_are_compared_with_those_alone() -> None:
    rows = beside.compared({"alone": [(10.0, 2.0), (20.0, 4.0), (12.0, 2.5)], "monitors": [(6.0, 5.0)]})
    assert rows["alone"] == {"samples_hz": 12.0, "rate_ratio": 1.0, "cpu_s": 2.5, "cpu_ratio": 1.0}
    assert (rows["monitors"]["rate_ratio"], rows["monitors"]["cpu_ratio"]) == (0.5, 2.0)
