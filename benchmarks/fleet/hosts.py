"""A fleet on three hosts with two recorders among random faults: the same dataset as in one process.

    python -m readygo.benchmarks.fleet.hosts --episodes 120 --faults 200

Hosts are network namespaces of this machine, joined by a bridge (`bridge.py`: root and `ip` are needed); all
speak mTLS. The first host has the coordinator, each of the others a recorder with its own disk and workers: one of
role `all` on the second, one of every role on the third. All workers have the same name, which is allowed: names differ
within a role only. The faults: a process is killed and started again, frozen, or its host cut off; a process of another
role takes the workers' name and leaves; a second process asks for a name that is taken; the coordinator is killed.
"""

import contextlib
import json
import random
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro

from readygo.benchmarks.fleet.bridge import PORT, Host, committed, hosts_on_a_bridge, readygo, set_link
from readygo.benchmarks.fleet.chaos import SETTINGS, compare
from readygo.benchmarks.rasterizer.render import machine
from readygo.common.dataset import Report, validate
from readygo.common.dataset.aside import read_set_aside
from readygo.common.messages.stages import EXPERT_LINE
from readygo.runs.folder import RunFolder

NAME = "desk-1"
"""Name of every worker."""
RECORDERS = ("rec0", "rec1")
GUEST = "driver"
"""Role of a worker that the line has no work for."""
POLL_S = 0.2
GUEST_S = 6.0
"""So long a process stays that takes another one's name [s]."""
LONGEST_S = 8.0
"""Longest freeze or cut [s]."""


@dataclass
class Process:
    """A process on a host, started again whenever it ends before the run does."""

    host: Host
    arguments: tuple[str, ...]
    running: "subprocess.Popen[bytes]"
    starts: int = 1
    done: bool = False

    def keep_up(self) -> None:
        """Start it again if it ended; one that ended with 0 has done its work."""
        code = self.running.poll()
        if code is None or self.done:
            return
        if code == 0:
            self.done = True
            return
        self.running = self.host.start(*self.arguments)
        self.starts += 1


@dataclass
class HostFleet:
    """All processes, and what was done to them."""

    hosts: tuple[Host, ...]
    processes: dict[str, Process]
    rng: random.Random
    happened: Counter[str] = field(default_factory=Counter)
    undo: list[tuple[float, Callable[[], None]]] = field(default_factory=list)

    def keep_up(self) -> None:
        """Start again what ended, and end faults whose time is over."""
        for process in self.processes.values():
            process.keep_up()
        now_s = time.monotonic()
        for end_s, undo in self.undo:
            if end_s <= now_s:
                undo()
        self.undo = [(end_s, undo) for end_s, undo in self.undo if end_s > now_s]

    def disturb(self) -> None:
        """Bring one fault about."""
        kind = self.rng.choice(list(FAULTS))
        FAULTS[kind](self)
        self.happened[kind] += 1

    def some(self, *, coordinator: bool = False) -> "subprocess.Popen[bytes]":
        """One of the processes, any but the coordinator's, or the coordinator's."""
        names = [name for name in self.processes if (name == "coordinator") is coordinator]
        return self.processes[self.rng.choice(names)].running

    def later(self, undo: Callable[[], None], after_s: float | None = None) -> None:
        """End a fault after some time."""
        duration_s = self.rng.uniform(0.3, LONGEST_S) if after_s is None else after_s
        self.undo.append((time.monotonic() + duration_s, undo))


def _kill(fleet: HostFleet) -> None:
    fleet.some().kill()


def _kill_coordinator(fleet: HostFleet) -> None:
    fleet.some(coordinator=True).kill()


def _freeze(fleet: HostFleet) -> None:
    process = fleet.some()
    process.send_signal(signal.SIGSTOP)
    fleet.later(lambda: process.send_signal(signal.SIGCONT))


def _cut(fleet: HostFleet) -> None:
    host = fleet.rng.choice(fleet.hosts[1:])
    set_link(host, "down")
    fleet.later(lambda: set_link(host, "up"))


def _take_name(fleet: HostFleet) -> None:
    """A worker of another role has the others' name for a while."""
    _visit(fleet, GUEST)


def _take_taken_name(fleet: HostFleet) -> None:
    """A second worker of a role asks for the name of the first."""
    _visit(fleet, fleet.rng.choice(("all", "renderer")))


def _visit(fleet: HostFleet, role: str) -> None:
    host = fleet.hosts[1] if role in ("all", GUEST) else fleet.hosts[2]
    recorder = fleet.processes["rec0"].arguments
    guest = host.start("worker", role, *recorder[2:6], "--name", NAME, "--certs", str(host.certs))
    fleet.later(guest.kill, GUEST_S)


FAULTS: Mapping[str, Callable[[HostFleet], None]] = {
    "a worker or recorder is killed": _kill,
    "the coordinator is killed": _kill_coordinator,
    "a process is stopped and continues": _freeze,
    "a host is cut off for a while": _cut,
    "a worker of another role takes the name": _take_name,
    "a second worker of the role asks for the name": _take_taken_name,
}


def main(
    *, episodes: int = 120, faults: int = 200, every_s: float = 1.5, seed: int = 0, timeout_s: float = 3000.0
) -> None:
    """Run it, and exit with 1 if an episode is missing, double, torn or of other bytes.

    Args:
        episodes: Episodes to record.
        faults: Faults meanwhile.
        every_s: Mean time between two faults [s].
        seed: Seed of the faults and of the run.
        timeout_s: Time for all of it [s].
    """
    deadline_s = time.monotonic() + timeout_s
    with tempfile.TemporaryDirectory() as name, hosts_on_a_bridge(Path(name)) as hosts:
        root = Path(name)
        settings = root / "settings.toml"
        settings.write_text(SETTINGS.replace('["rec0", "rec1", "rec2"]', json.dumps(list(RECORDERS))))
        what = ("embedded", "--episodes", str(episodes), "--seed", str(seed), "--config", str(settings))
        readygo("generate", *what, "--out", str(root / "alone"), "--workers", "0")
        _issue(root / "authority", hosts)
        with _fleet(hosts, what, seed, deadline_s) as fleet:
            _disturb(fleet, faults, every_s, deadline_s)
        shards = [hosts[2].root / "shards", hosts[1].root / "shards"]
        result = _result(root / "alone", shards, fleet, hosts[0].root / "data")
    print(json.dumps(result, indent=2))
    if not result["ok"]:
        raise SystemExit(1)


def _issue(authority: Path, hosts: Sequence[Host]) -> None:
    readygo("certs", "init", str(authority))
    roles = [stage.role for stage in EXPERT_LINE]
    names = (["coordinator"], ["all", GUEST, "recorder.rec1"], [*roles, "recorder.rec0"])
    for host, own in zip(hosts, names, strict=True):
        where = ["--authority", str(authority), "--out", str(host.certs), "--host", host.address]
        readygo("certs", "issue", *own, *where)


@contextlib.contextmanager
def _fleet(hosts: tuple[Host, ...], what: Sequence[str], seed: int, deadline_s: float) -> Iterator[HostFleet]:
    first, second, third = hosts
    data = first.root / "data"
    listen = ("--listen", f"tls/0.0.0.0:{PORT}", "--certs", str(first.certs))
    begin = first.start("generate", *what, "--out", str(data), "--on", "hosts", *listen)
    while not (data / ".readygo" / "endpoint").exists():
        if begin.poll() is not None or time.monotonic() > deadline_s:
            raise SystemExit("The run does not begin.")
        time.sleep(POLL_S)
    run = RunFolder(data).load()[0].run
    lead = Process(first, ("coordinator", str(data), *listen), begin)
    fleet = HostFleet(hosts, {"coordinator": lead}, random.Random(seed))

    def add(name: str, host: Host, role: str, *own: str) -> None:
        join = ("--connect", f"tls/{first.address}:{PORT}", "--run", run)
        arguments = ("worker", role, *join, *own, "--certs", str(host.certs))
        fleet.processes[name] = Process(host, arguments, host.start(*arguments))

    for recorder, host in zip(RECORDERS, (third, second), strict=True):
        add(recorder, host, "recorder", "--name", recorder, "--data", str(host.root / "shards"))
    add("all", second, "all", "--name", NAME)
    for stage in EXPERT_LINE:
        add(stage.role, third, stage.role, "--name", NAME)
    try:
        yield fleet
    finally:
        for process in fleet.processes.values():
            process.running.kill()
            process.running.wait()


def _disturb(fleet: HostFleet, faults: int, every_s: float, deadline_s: float) -> None:
    """Let faults happen until the run is over, and until all shards are finished."""
    next_s = time.monotonic()
    while not all(process.done for process in fleet.processes.values()):
        if time.monotonic() > deadline_s:
            raise SystemExit(f"It took too long: {committed(fleet.hosts[0].root / 'data')} episodes.")
        fleet.keep_up()
        over = fleet.processes["coordinator"].done
        if not over and fleet.happened.total() < faults and time.monotonic() > next_s:
            fleet.disturb()
            next_s = time.monotonic() + fleet.rng.expovariate(1.0 / every_s)
        time.sleep(POLL_S)
    for _, undo in fleet.undo:
        undo()


def _result(alone: Path, shards: list[Path], fleet: HostFleet, data: Path) -> dict[str, Any]:
    reports = [validate(place) for place in shards]
    whole = Report(
        folder=data,
        shard_count=sum(report.shard_count for report in reports),
        episode_count=sum(report.episode_count for report in reports),
        sample_count=sum(report.sample_count for report in reports),
        size_bytes=sum(report.size_bytes for report in reports),
        defects=tuple(defect for report in reports for defect in report.defects),
        notes=(),
    )
    outcome = compare([alone], shards, whole)
    aside = read_set_aside(data)
    return {
        "machine": machine(),
        "ok": outcome.ok and not aside,
        "episodes": outcome.episodes,
        "missing": outcome.missing,
        "double": outcome.double,
        "torn": outcome.torn,
        "wrong": outcome.wrong,
        "set_aside": aside,
        "faults": fleet.happened.total(),
        "by_kind": dict(fleet.happened),
        "starts": {name: process.starts for name, process in fleet.processes.items()},
    }


if __name__ == "__main__":
    tyro.cli(main)
