import random
import signal
import time
from pathlib import Path

from readygo.benchmarks.fleet import hosts as module
from readygo.benchmarks.fleet.bridge import Host
from readygo.benchmarks.fleet.hosts import FAULTS, HostFleet, Process


class StandIn:
    """A process that does what it is told."""

    def __init__(self, code: int | None = None) -> None:
        self.code = code
        self.got: list[object] = []

    def poll(self) -> int | None:
        return self.code

    def kill(self) -> None:
        self.got.append("kill")

    def send_signal(self, number: int) -> None:
        self.got.append(number)


class StandInHost(Host):
    started: "list[tuple[str, ...]]" = []  # noqa: RUF012

    def start(self, *arguments: str) -> StandIn:  # type: ignore[override]
        self.started.append(arguments)
        return StandIn()


def _fleet(monkeypatch) -> HostFleet:
    StandInHost.started.clear()
    hosts = tuple(StandInHost(number, Path("nowhere")) for number in (1, 2, 3))
    join = ("--connect", "tls/10.99.7.1:7447", "--run", "run-x")
    names = {"coordinator": hosts[0], "rec0": hosts[2], "all": hosts[1]}
    processes = {name: Process(host, ("worker", name, *join), StandIn()) for name, host in names.items()}  # type: ignore[arg-type]
    monkeypatch.setattr(module, "set_link", lambda host, state: links.append((host.number, state)))
    links: list[tuple[int, str]] = []
    fleet = HostFleet(hosts, processes, random.Random(0))
    fleet.links = links  # type: ignore[attr-defined]
    return fleet


def test_process_that_ends_early_is_started_again_and_one_that_is_done_is_not(monkeypatch) -> None:
    fleet = _fleet(monkeypatch)
    fleet.processes["rec0"].running.code = -9
    fleet.processes["all"].running.code = 0
    fleet.keep_up()
    fleet.keep_up()
    assert [arguments[1] for arguments in StandInHost.started] == ["rec0"]
    assert (fleet.processes["rec0"].starts, fleet.processes["all"].done) == (2, True)


def test_faults_that_last_are_ended(monkeypatch) -> None:
    fleet = _fleet(monkeypatch)
    FAULTS["a process is stopped and continues"](fleet)
    FAULTS["a host is cut off for a while"](fleet)
    frozen = next(p.running for p in fleet.processes.values() if p.running.got)
    assert frozen.got == [signal.SIGSTOP]
    ((number, state),) = fleet.links
    assert number in (2, 3)
    assert state == "down"
    monkeypatch.setattr(time, "monotonic", lambda: 1e12)
    fleet.keep_up()
    assert frozen.got == [signal.SIGSTOP, signal.SIGCONT]
    assert fleet.links[1:] == [(number, "up")]
    assert fleet.undo == []


def test_names_are_taken_in_another_role_and_in_the_same(monkeypatch) -> None:
    fleet = _fleet(monkeypatch)
    for kind in ("a worker of another role takes the name", "a second worker of the role asks for the name"):
        FAULTS[kind](fleet)
    first, second = StandInHost.started
    assert first[1] == module.GUEST
    assert second[1] in ("all", "renderer")
    for arguments in (first, second):
        assert arguments[2:8] == ("--connect", "tls/10.99.7.1:7447", "--run", "run-x", "--name", module.NAME)


def test_every_kind_happens_and_is_counted(monkeypatch) -> None:
    fleet = _fleet(monkeypatch)
    for _ in range(60):
        fleet.disturb()
    assert set(fleet.happened) == set(FAULTS)
    assert fleet.happened.total() == 60
    assert "kill" in fleet.processes["coordinator"].running.got
