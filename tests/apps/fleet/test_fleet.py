import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from readygo.apps.fleet.fleet import CANNOT_WORK, RESTARTS_MAX, RESTARTS_S, Fleet, Member
from readygo.common.errors import RunError

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


def _wait_for_end(member: Member) -> None:
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
    member = Member(role="trainer", name="t", log=tmp_path / "t.log", arguments=("--out", "policy"))
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
    assert "secret" not in fleet.command(Member(role="all", name="w0", log=tmp_path / "log"))
