import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.fleet.fork_server import Forked, ForkServer
from readygo.common.errors import CANNOT_WORK, RunError

NOWHERE = ("--connect", "tcp/127.0.0.1:1")
NAMELESS = ("worker", "trainer", *NOWHERE)
"""A worker that ends at once: nothing names its run."""
WAITING = ("worker", "all", *NOWHERE, "--run", "r", "--exit-with-parent")
"""A worker that waits for its router."""
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    server = ForkServer({**os.environ, "READYGO_TOKEN": "secret"}, tmp_path_factory.mktemp("server") / "log")
    yield server
    server.close()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


@pytest.fixture
def waiting(server: ForkServer, log: Path) -> Iterator[Forked]:
    process = _start(server, log, WAITING)
    yield process
    process.kill()
    process.wait(LIMIT_S)
    process.stdin.close()


def _start(server: ForkServer, log: Path, words: tuple[str, ...]) -> Forked:
    with log.open("ab") as output:
        return server.start(words, output.fileno())


def _exit_code(server: ForkServer, log: Path) -> int:
    process = _start(server, log, NAMELESS)
    with process.stdin:
        process.wait(LIMIT_S)
    process.terminate()
    assert process.poll() == process.returncode
    return process.returncode


def _until_it_listens(log: Path) -> None:
    """Its signals and its standard input are heard before it looks for a router, which it says."""
    deadline_s = time.monotonic() + LIMIT_S
    while not log.read_text():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_worker_says_what_it_has_to_say_and_its_exit_code_is_known(server: ForkServer, log: Path) -> None:
    assert _exit_code(server, log) == CANNOT_WORK
    assert log.read_text() == "readygo: A trainer needs the name of its run: pass --run.\n"


def test_worker_is_listed_by_its_own_command(waiting: Forked, log: Path) -> None:
    _until_it_listens(log)
    assert Path(f"/proc/{waiting.pid}/cmdline").read_bytes().rstrip(b"\0").decode().split() == ["readygo", *WAITING]
    assert os.getsid(waiting.pid) == waiting.pid


def test_server_has_no_thread_that_a_fork_would_leave_behind(server: ForkServer, waiting: Forked) -> None:
    assert server._process is not None
    assert len(os.listdir(f"/proc/{server._process.pid}/task")) == 1


def test_worker_holds_no_descriptor_of_the_workers_before_it(
    server: ForkServer, waiting: Forked, tmp_path: Path
) -> None:
    log = tmp_path / "second"
    second = _start(server, log, WAITING)
    try:
        _until_it_listens(log)
        held = [os.readlink(link) for link in Path(f"/proc/{second.pid}/fd").iterdir()]
    finally:
        second.kill()
        second.wait(LIMIT_S)
        second.stdin.close()
    assert str(log) in held
    assert not [what for what in held if "pidfd" in what]


def test_worker_that_is_killed_ended_by_that(waiting: Forked) -> None:
    assert waiting.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        waiting.wait(0.01)
    waiting.kill()
    assert waiting.wait(LIMIT_S) == -signal.SIGKILL


def test_worker_ends_when_nobody_holds_its_standard_input(waiting: Forked, log: Path) -> None:
    _until_it_listens(log)
    waiting.stdin.close()
    assert waiting.wait(LIMIT_S) is not None


def test_server_that_died_is_started_anew_and_takes_no_worker_with_it(
    server: ForkServer, waiting: Forked, log: Path
) -> None:
    assert server._process is not None
    server._process.kill()
    server._process.wait()
    assert waiting.poll() is None
    assert _exit_code(server, log) == CANNOT_WORK
    waiting.kill()
    assert waiting.wait(LIMIT_S) == -signal.SIGKILL


def test_server_that_ends_is_started_twice_and_then_the_reason_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python, log = tmp_path / "python", tmp_path / "server.log"
    python.write_text("#!/bin/sh\necho no memory\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    server = ForkServer(os.environ, log)
    reasons = "the fork server ended|Broken pipe|Connection reset by peer"
    with pytest.raises(RunError, match=rf"^No worker can be started \(({reasons})\); see {re.escape(str(log))}\.$"):
        _start(server, tmp_path / "worker.log", NAMELESS)
    assert log.read_text() == "no memory\n" * 2


def test_server_that_cannot_be_started_names_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "nothing"))
    with pytest.raises(RunError, match=r"^No worker can be started \(No such file or directory\); see "):
        _start(ForkServer(os.environ, tmp_path / "log"), tmp_path / "worker.log", NAMELESS)
