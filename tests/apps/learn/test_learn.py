"""`readygo learn` from end to end: small episodes, killed in the middle, and gone on with."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.learn import learn
from readygo.apps.learn.curve import load_curve, measurements_of
from readygo.common.dataset import validate
from readygo.common.policy import load_policy
from readygo.runs.origin import origin_of_policy

CONFIG = """
[episode]
goal_distance_min_m = 1.5
goal_distance_max_m = 2.5
time_limit_s = 6.0
human_count_max = 1
"""
LIMIT_S = 400.0


def test_data_are_complete_before_the_test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    supervisor = SimpleNamespace(learn=lambda: order.append("learned"), points=[], minutes=1.0)
    tests = SimpleNamespace(test=lambda *_: order.append("tested"))
    monkeypatch.setattr(learn, "Supervisor", lambda *_: supervisor)
    monkeypatch.setattr(learn, "Measuring", lambda _: tests)
    plan = SimpleNamespace(out=tmp_path, policy=tmp_path / "policy")
    learn.learn_policy(plan, episodes=1, recorded=lambda: order.append("recorded"))
    assert order == ["learned", "recorded", "tested"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    (tmp_path / "run.toml").write_text(CONFIG)
    options = [
        str(tmp_path / "run"),
        "--minutes",
        "0.8",
        "--episodes",
        "1",
        "--config",
        str(tmp_path / "run.toml"),
        "--json",
    ]
    command = [sys.executable, "-m", "readygo", "learn", "embedded", "--form", "policy", "--out", *options]
    processes = []

    def started() -> subprocess.Popen[str]:
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return processes[-1]

    yield started
    for process in processes:
        process.kill()
        process.communicate()


def wait_until(true: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.2)


def workers_of(out: Path, role: str = "") -> list[int]:
    """Processes of a run's workers, by the folders in their command lines."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().decode(errors="replace").replace("\0", " ").split()
        except OSError:
            continue
        if "worker" in words and any(str(out) in word for word in words) and (not role or role in words):
            found.append(int(entry.parent.name))
    return found


def recorded_bytes(out: Path) -> int:
    return sum(path.stat().st_size for path in (out / "data" / "embedded").glob("shard-*.mcap*"))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="finds processes in /proc")
def test_run_that_is_killed_goes_on_with_the_same_command(
    start: Callable[[], subprocess.Popen[str]], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    first = start()
    wait_until(lambda: (out / "policy" / "progress.json").exists())
    (trainer,) = workers_of(out, "trainer")
    os.kill(trainer, signal.SIGSTOP)
    before = recorded_bytes(out)
    wait_until(lambda: recorded_bytes(out) > before)
    with suppress(ProcessLookupError):  # Where recording was ahead and paused, the run has ended the frozen one itself.
        os.kill(trainer, signal.SIGKILL)
    wait_until(lambda: workers_of(out, "trainer") not in ([], [trainer]))
    assert first.poll() is None, "a trainer that dies is replaced"
    wait_until(lambda: (out / "curve.json").exists())
    spent_s = json.loads((out / "learn.json").read_text())["spent_s"]
    assert spent_s > 0
    first.send_signal(signal.SIGKILL)
    first.wait()
    wait_until(lambda: not workers_of(out))

    second = start()
    printed, errors = second.communicate(timeout=LIMIT_S)
    assert second.returncode == 0, errors
    result = json.loads(printed)
    assert result["minutes"] >= spent_s / 60
    assert json.loads((out / "learn.json").read_text())["over"] == {"minutes": 0.8, "samples": None}
    assert not workers_of(out)
    assert validate(out / "data" / "embedded").ok
    policy = load_policy(out / "policy")
    origin = origin_of_policy(policy.spec)
    assert origin is not None
    assert "embedded" in origin.scenes.values()
    assert origin.settings["episode"]["goal_distance_max_m"] == 2.5
    points = load_curve(out / "curve.json")
    assert points[-1].measurement == measurements_of(points)[-1]
    assert [point.minutes for point in points] == sorted(point.minutes for point in points)
    assert "embedded" in result["test"]
    assert (out / "report.html").stat().st_size > 10_000
