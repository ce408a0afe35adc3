import os
import subprocess
import sys

import pytest

from readygo.benchmarks.recording import memory

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


@pytest.fixture
def worker():
    """A process that looks like a worker of this one."""
    code = "import sys; print(flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", code, "worker", "renderer", "--name", "r7"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        # Its command line can be read for sure once it runs.
        process.stdout.readline()
        yield process
        process.stdin.close()


def test_workers_are_found_by_their_parent_and_named(worker) -> None:
    assert (worker.pid, "r7") in memory.workers_below(os.getpid())
    assert memory.workers_below(worker.pid) == []


def test_workers_of_a_fork_server_are_found_as_well(worker) -> None:
    assert (worker.pid, "r7") in memory.workers_below(os.getppid())


def test_memory_is_read_in_megabytes_until_the_process_ends() -> None:
    reading = memory.reading_of(os.getpid())
    assert 5 < reading["private_mb"] <= reading["resident_mb"] < 10_000
    assert memory.reading_of(2**22 + 1) is None


def test_most_is_kept_of_all_readings(monkeypatch) -> None:
    polls = iter([None, None, None, 0])
    sizes = iter([10.0, 30.0, 20.0])
    monkeypatch.setattr(memory, "PERIOD_S", 0.0)
    monkeypatch.setattr(memory, "workers_below", lambda pid: [(1, "r0")])
    monkeypatch.setattr(memory, "reading_of", lambda pid: {"private_mb": next(sizes), "resident_mb": 40.0})
    run = type("Run", (), {"pid": 1, "poll": lambda self: next(polls)})()
    assert memory._watched(run) == {"r0": {"private_mb": 20.0, "resident_mb": 40.0, "most_mb": 30.0}}
