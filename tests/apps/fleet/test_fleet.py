import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.fleet import fleet as supervision
from readygo.apps.fleet.fleet import RESTARTS_MAX, RESTARTS_S, Fleet, FleetMember, last_words
from readygo.common.errors import CANNOT_WORK, RunError

OBEYS = """
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
print("up", flush=True)
time.sleep(60)
"""


class ScriptedFleet(Fleet):
    """A fleet whose workers run a line of Python."""

    def __init__(self, folder: Path, script: str) -> None:
        super().__init__(connect="", run="", data=folder, logs=folder, forks=self)
        self.script = script

    def start(self, words: list[str], output: int) -> subprocess.Popen[bytes]:
        """In place of a fork server's."""
        command = [sys.executable, "-c", self.script]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=output, stderr=output)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str, str], ScriptedFleet]]:
    fleets = []

    def started(role: str, script: str) -> ScriptedFleet:
        fleet = ScriptedFleet(tmp_path, script)
        fleets.append(fleet)
        fleet.add(role, "w0")
        return fleet

    yield started
    for fleet in fleets:
        fleet.stop()


def _wait_for_end(member: FleetMember) -> None:
    assert member.process is not None
    member.process.wait(timeout=20)


def test_worker_that_was_told_to_stop_by_somebody_else_is_started_anew(
    start: Callable[[str, str], ScriptedFleet],
) -> None:
    fleet = start("animator", OBEYS)
    (member,) = fleet.members
    assert member.process is not None
    while "up" not in member.log.read_text():
        time.sleep(0.02)
    member.process.send_signal(signal.SIGTERM)
    _wait_for_end(member)
    assert member.process.returncode == 0
    fleet.check()
    assert member.process.poll() is None
    assert member.restarts == 1


def test_worker_that_dies_again_and_again_ends_the_run_with_its_last_words(
    start: Callable[[str, str], ScriptedFleet],
) -> None:
    fleet = start("animator", "raise SystemExit('out of luck')")
    fleet.members[0].restarted_s.extend([time.monotonic()] * (RESTARTS_MAX - 1))
    _wait_for_end(fleet.members[0])
    fleet.check()
    _wait_for_end(fleet.members[0])
    with pytest.raises(RunError, match=r"Worker w0 ended with exit code 1: out of luck"):
        fleet.check()


@pytest.mark.parametrize(("code", "fails"), [(0, False), (2, True)])
def test_recorder_that_could_not_finish_its_shard_is_not_passed_over(
    start: Callable[[str, str], ScriptedFleet], code: int, fails: bool
) -> None:
    fleet = start("recorder", f"import sys; print('readygo: No space left in data.'); sys.exit({code})")
    _wait_for_end(fleet.members[0])
    fleet.stop()
    if not fails:
        fleet.check_recorders()
        return
    with pytest.raises(RunError, match=r"w0 could not finish its shard \(exit code 2\): readygo: No space left"):
        fleet.check_recorders()


def test_recorder_that_was_stopped_while_it_started_matters_only_if_a_shard_is_unfinished(
    start: Callable[[str, str], ScriptedFleet], tmp_path: Path
) -> None:
    fleet = start("recorder", "import time; time.sleep(60)")
    fleet.stop()
    fleet.check_recorders()
    (tmp_path / "shard-w0-00000.mcap.part").touch()
    with pytest.raises(RunError, match=r"w0 could not finish its shard \(exit code -15\)"):
        fleet.check_recorders()


@pytest.mark.parametrize(("code", "fatal"), [(CANNOT_WORK, True), (2, False)])
def test_worker_that_cannot_work_ends_the_run_but_one_that_lost_the_bus_is_started_anew(
    start: Callable[[str, str], ScriptedFleet], code: int, fatal: bool
) -> None:
    fleet = start("animator", f"import sys; print('readygo: why', flush=True); sys.exit({code})")
    _wait_for_end(fleet.members[0])
    if fatal:
        with pytest.raises(RunError, match=r"Worker w0 ended with exit code 78: readygo: why"):
            fleet.check()
    else:
        fleet.check()
        assert fleet.members[0].restarts == 1


def test_coordinator_stops_last_and_recorders_before_it(tmp_path: Path) -> None:
    fleet = ScriptedFleet(tmp_path, "")
    for role in ("coordinator", "recorder", "painter"):
        log = tmp_path / "order"
        fleet.script = (
            "import signal, sys, time\n"
            f"def end(*_): open({str(log)!r}, 'a').write({role!r} + ' '); sys.exit(0)\n"
            "signal.signal(signal.SIGTERM, end)\nprint('up', flush=True)\ntime.sleep(60)"
        )
        fleet.add(role, role)
    while any("up" not in member.log.read_text() for member in fleet.members):
        time.sleep(0.02)
    fleet.stop()
    assert (tmp_path / "order").read_text().split() == ["painter", "recorder", "coordinator"]


def test_worker_that_is_removed_has_ended_and_is_not_started_again(start: Callable[[str, str], ScriptedFleet]) -> None:
    fleet = start("all", OBEYS)
    fleet.add("all", "w1")
    gone = fleet.members[0].process
    assert gone is not None
    fleet.remove("w0")
    assert gone.poll() is not None
    fleet.check()
    assert [member.name for member in fleet.members] == ["w1"]


def test_worker_that_is_killed_is_started_anew(start: Callable[[str, str], ScriptedFleet]) -> None:
    fleet = start("all", OBEYS)
    before = fleet.members[0].process
    fleet.kill("recorder")
    assert before is not None
    assert before.poll() is None, "it has another role"
    fleet.kill("all")
    assert before.poll() is not None
    fleet.check()
    after = fleet.members[0].process
    assert after is not None
    assert after.pid != before.pid


def test_member_has_arguments_of_its_own_and_a_fleet_all_its_data_folders(tmp_path: Path) -> None:
    fleet = Fleet(connect="tcp/x:1", run="a,b", data=[tmp_path / "a", tmp_path / "b"], logs=tmp_path)
    member = FleetMember(role="trainer", name="t", log=tmp_path / "t.log", arguments=("--out", "policy"))
    words = fleet.command(member)
    assert words[words.index("--out") + 1] == "policy"
    begin = words.index("--data")
    assert words[begin + 1 : begin + 3] == [str(tmp_path / "a"), str(tmp_path / "b")]


def test_worker_that_died_often_long_ago_is_started_anew(start: Callable[[str, str], ScriptedFleet]) -> None:
    fleet = start("animator", "raise SystemExit('once a week')")
    fleet.members[0].restarted_s.extend([time.monotonic() - RESTARTS_S - 1.0] * 3 * RESTARTS_MAX)
    _wait_for_end(fleet.members[0])
    fleet.check()
    assert fleet.members[0].restarts == 1


def test_worker_that_somebody_stopped_is_started_anew(
    start: Callable[[str, str], ScriptedFleet], monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet = start("renderer", OBEYS)
    frozen = fleet.members[0].process
    assert frozen is not None
    frozen.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, frozen.pid, os.WSTOPPED)
    fleet.check()
    assert frozen.poll() is None, "it may go on in a moment"
    monkeypatch.setattr("readygo.apps.fleet.fleet.FROZEN_S", 0.0)
    fleet.check()
    assert frozen.poll() is not None
    again = fleet.members[0].process
    assert again is not None
    assert again.pid != frozen.pid
    assert again.poll() is None


def test_stopped_worker_does_not_hold_up_the_end(start: Callable[[str, str], ScriptedFleet]) -> None:
    fleet = start("renderer", OBEYS)
    member = fleet.members[0]
    while "up" not in member.log.read_text():
        time.sleep(0.02)
    assert member.process is not None
    member.process.send_signal(signal.SIGSTOP)
    fleet.stop()
    assert member.process.returncode == 0


def test_processes_are_told_the_token_and_nobody_sees_it_on_their_command_line(tmp_path: Path) -> None:
    fleet = Fleet(connect="tcp/x:1", run="a", data=tmp_path, logs=tmp_path, token="secret")
    assert fleet._forks._environment["READYGO_TOKEN"] == "secret"
    assert "secret" not in fleet.command(FleetMember(role="all", name="w0", log=tmp_path / "log"))


class FakeProcess:
    """A worker's process that ends when it is told, or not at all."""

    def __init__(self, number: int, place: "FakeForks") -> None:
        self.pid, self.place, self.returncode = number, place, None
        self.stubborn, self.stdin = False, SimpleNamespace(close=lambda: self.note("closed"))

    def note(self, what: str) -> None:
        self.place.said.append((self.pid, what))

    def poll(self) -> int | None:
        return self.returncode

    def terminate(self) -> None:
        self.note("terminated")

    def send_signal(self, number: int) -> None:
        self.note(signal.Signals(number).name)

    def kill(self) -> None:
        self.note("killed")
        self.stubborn, self.returncode = False, -signal.SIGKILL

    def wait(self, timeout: float | None = None) -> int:
        if timeout is not None:
            self.note(f"waited {timeout:g}")
            self.place.now_s += 1.5
        if self.stubborn:
            raise subprocess.TimeoutExpired("w", timeout or 0.0)
        self.returncode = self.returncode or 0
        return self.returncode


class FakeForks:
    """Stands in for a fork server and for the clock."""

    def __init__(self) -> None:
        self.now_s, self.stopped = 5000.0, set[int]()
        self.processes: list[FakeProcess] = []
        self.said: list[tuple[int, str]] = []

    def start(self, words: list[str], output: int) -> FakeProcess:
        self.processes.append(FakeProcess(len(self.processes), self))
        return self.processes[-1]

    def close(self) -> None:
        self.said.append((-1, "closed"))


@pytest.fixture
def forks(monkeypatch: pytest.MonkeyPatch) -> FakeForks:
    forks = FakeForks()
    monkeypatch.setattr(supervision, "time", SimpleNamespace(monotonic=lambda: forks.now_s))
    monkeypatch.setattr(supervision, "_is_stopped", lambda pid: pid in forks.stopped)
    return forks


@pytest.fixture
def faked(forks: FakeForks, tmp_path: Path) -> Fleet:
    return Fleet(connect="tcp/x:1", run="a", data=tmp_path, logs=tmp_path, forks=forks)  # type: ignore[arg-type]


def test_worker_is_started_anew_ten_times_an_hour(forks: FakeForks, faked: Fleet) -> None:
    faked.add("animator", "w0")
    for number in range(10):
        forks.processes[-1].returncode = 1
        faked.check()
        assert len(forks.processes) == number + 2
        faked.check()
        assert len(forks.processes) == number + 2, "it runs"
        forks.now_s += 100.0
    forks.processes[-1].returncode = 1
    forks.now_s = 5000.0 + 3600.0
    with pytest.raises(RunError, match=r"w0 ended with exit code 1: it left no log|w0 ended with exit code 1: "):
        faked.check()
    forks.now_s += 0.5
    faked.check()
    assert (len(forks.processes), faked.members[0].restarts) == (12, 11)
    assert [pid for pid, what in forks.said if what == "closed"] == list(range(11)), "of those that ended"


def test_process_that_is_stopped_for_20_seconds_is_started_anew(forks: FakeForks, faked: Fleet) -> None:
    for name in ("w0", "w1"):
        faked.add("renderer", name)
    forks.stopped = {1}
    faked.check()
    forks.now_s += 19.9
    faked.check()
    forks.stopped = set()
    faked.check()
    forks.stopped = {1}
    faked.check()
    forks.now_s += 19.9
    faked.check()
    assert len(forks.processes) == 2, "it went on in between"
    forks.now_s += 0.1
    faked.check()
    assert [member.process.pid for member in faked.members if member.process] == [0, 2]
    assert (1, "killed") in forks.said


def test_end_gives_workers_5_seconds_together_and_recorders_and_the_coordinator_15_each(
    forks: FakeForks, faked: Fleet
) -> None:
    for role in ("coordinator", "animator", "recorder", "renderer", "animator", "animator", "animator"):
        faked.add(role, f"{role}{len(faked.members)}")
    forks.processes[3].stubborn = True
    faked.stop()
    waits = {pid: what for pid, what in forks.said if what.startswith("waited")}
    assert waits == {
        1: "waited 5", 3: "waited 3.5", 4: "waited 2", 5: "waited 0.5", 6: "waited 0.1", 2: "waited 15", 0: "waited 15"
    }  # fmt: skip
    first = [pid for pid, what in forks.said if what == "terminated"]
    assert (sorted(first[:5]), first[5:]) == ([1, 3, 4, 5, 6], [2, 0])
    assert [pid for pid, what in forks.said if what == "killed"] == [3]
    for pid in range(7):
        said = [what for other, what in forks.said if other == pid]
        assert said[:2] == ["terminated", "SIGCONT"]
        assert said[-1] == "closed"
    assert (-1, "closed") not in forks.said, "the fork server is another's"


def test_process_ends_with_the_arguments_of_its_fleet(tmp_path: Path, forks: FakeForks) -> None:
    fleet = Fleet(
        connect="tls/x:1", run="a,b", data=[tmp_path / "a", tmp_path / "b"], logs=tmp_path, certs=tmp_path / "certs",
        forks=forks,  # type: ignore[arg-type]
    )  # fmt: skip
    fleet.add("trainer", "t", "--out", "policy")
    assert fleet.command(fleet.members[0]) == [
        "worker", "trainer", "--name", "t", "--out", "policy", "--connect", "tls/x:1", "--run", "a,b",
        "--data", str(tmp_path / "a"), str(tmp_path / "b"), "--exit-with-parent", "--certs", str(tmp_path / "certs"),
    ]  # fmt: skip
    assert fleet.members[0].log == tmp_path / "t.log"


@pytest.mark.parametrize("role", ["recorder", "renderer"])
@pytest.mark.parametrize("code", [0, 1, -signal.SIGTERM, -signal.SIGKILL])
@pytest.mark.parametrize("unfinished", [False, True])
def test_only_a_recorder_that_left_a_shard_unfinished_is_told(
    faked: Fleet, forks: FakeForks, tmp_path: Path, role: str, code: int, unfinished: bool
) -> None:
    faked.add(role, "w0")
    forks.processes[0].returncode = code
    if unfinished:
        (tmp_path / "shard-w0-00003.mcap.part").touch()
    if role == "recorder" and (code in (1, -signal.SIGKILL) or (code == -signal.SIGTERM and unfinished)):
        with pytest.raises(RunError, match=rf"Recorder w0 could not finish its shard \(exit code {code}\)"):
            faked.check_recorders()
    else:
        faked.check_recorders()


def test_last_line_of_a_log_is_what_a_worker_said_last(tmp_path: Path) -> None:
    assert last_words(tmp_path / "none.log") == "it left no log."
    (tmp_path / "w.log").write_text("first\nlast\n\n")
    assert last_words(tmp_path / "w.log") == "last"


def test_process_that_runs_or_is_gone_is_not_stopped() -> None:
    assert not supervision._is_stopped(os.getpid())
    assert not supervision._is_stopped(2**30)
