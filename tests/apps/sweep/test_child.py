import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from readygo.apps.sweep import child
from readygo.apps.sweep.child import end_child, start_child, start_job

SLEEP = [sys.executable, "-c", "import time; time.sleep(60)"]


def test_child_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    said = tmp_path / "pid"
    code = (
        "import pathlib, time; from readygo.apps.sweep.child import start_child; "
        f"p = start_child({SLEEP!r}); pathlib.Path({str(said)!r}).write_text(str(p.pid)); time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    while not said.exists() or not said.read_text():
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    deadline_s = time.monotonic() + 10
    while _lives(int(said.read_text())) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not _lives(int(said.read_text()))


def _lives(pid: int) -> bool:
    with suppress(OSError):
        return ") Z" not in Path(f"/proc/{pid}/stat").read_text()
    return False


def test_child_is_ended_and_killed_if_it_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    process = start_child(SLEEP)
    end_child(process)
    assert process.returncode == -signal.SIGTERM
    end_child(process)
    monkeypatch.setattr(child, "END_S", 0.2)
    stubborn = start_child([sys.executable, "-c", "import signal,time; signal.signal(15, 1); print(1, flush=True); "
                            "time.sleep(60)"], stdout=None)  # fmt: skip
    time.sleep(1.0)
    end_child(stubborn)
    assert stubborn.returncode == -signal.SIGKILL


def test_output_of_a_job_is_added_to_its_log(tmp_path: Path) -> None:
    log = tmp_path / "a" / "log"
    for _ in range(2):
        command = [sys.executable, "-c", "import os, sys; print(os.getcwd()); print('no', file=sys.stderr)"]
        assert start_job(command, log, cwd=tmp_path).wait() == 0
    assert sorted(log.read_text().splitlines()) == sorted([os.fspath(tmp_path), "no"] * 2)
