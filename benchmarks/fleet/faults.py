"""Faults: a schedule that a seed fixes, and how each is brought about."""

import contextlib
import enum
import math
import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from readygo.benchmarks.fleet.hostile import send_lies
from readygo.benchmarks.fleet.site import LAUNCHER, DataSite
from readygo.common.dataset.places import own_folders
from readygo.common.errors import BusError, ReadygoError, RunError
from readygo.common.messages import StatusRequest, topics
from readygo.common.messages.fleet import FleetRequest
from readygo.runs.recorders import requeue

SHORTEST_S = 0.3
"""Shortest duration of a freeze or of a full disk [s]."""


class Kind(enum.Enum):
    """What goes wrong."""

    KILL = "a worker is killed"
    KILL_TWO = "two workers are killed at once"
    FREEZE = "a worker is stopped and continues"
    FREEZE_ROUTER = "the launcher with the router is stopped and continues"
    KILL_LAUNCHER = "the launcher with the router is killed, and started again"
    END_LAUNCHER = "the launcher is told to end, and started again"
    DAMAGE_BLOB = "a result between the stages is damaged"
    DAMAGE_SHARD = "a byte of a shard is changed"
    CUT_SHARD = "a shard is cut off"
    LOSE_SHARD = "a shard is removed"
    LOSE_LEDGER = "the ledger is removed, and the launcher started again"
    LOSE_DISK = "a recorder's own disk is lost, and it is given up"
    FULL_DISK = "the disk is full for a while"
    HOSTILE = "hostile messages"
    TWICE_NAMED = "processes of other roles take the workers' names, and leave"


WEIGHTS = {
    Kind.KILL: 60,
    Kind.KILL_TWO: 12,
    Kind.FREEZE: 40,
    Kind.FREEZE_ROUTER: 10,
    Kind.KILL_LAUNCHER: 8,
    Kind.END_LAUNCHER: 6,
    Kind.DAMAGE_BLOB: 20,
    Kind.DAMAGE_SHARD: 8,
    Kind.CUT_SHARD: 4,
    Kind.LOSE_SHARD: 4,
    Kind.LOSE_LEDGER: 3,
    Kind.LOSE_DISK: 1,
    Kind.FULL_DISK: 10,
    Kind.HOSTILE: 14,
    Kind.TWICE_NAMED: 14,
}
"""How much more often than others a kind comes up."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault."""

    kind: Kind
    after: int
    """The fault happens after this many episodes are durable,"""
    delay_s: float
    """plus this delay, at any moment of the work that is under way [s]."""
    pick: float
    """Which process, file or byte, 0..1."""
    duration_s: float
    """Duration of a fault that ends by itself [s]."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What came of a fault."""

    words: str
    skipped: bool = False
    """True if there was nothing that it could have hit, or no means to bring it about."""
    later: bool = False
    """True if there may be something to hit soon."""
    undo: Callable[[], None] | None = None
    """Ends it, for a fault that lasts."""


def schedule(episodes: int, faults: int, seed: int, *, longest_s: float) -> list[Fault]:
    """Faults in the order of time, spread over a run of so many episodes: each kind once, then by their weights."""
    rng = random.Random(seed)
    kinds = [*WEIGHTS, *rng.choices(list(WEIGHTS), list(WEIGHTS.values()), k=faults)][:faults]
    rng.shuffle(kinds)
    after = sorted(rng.randrange(episodes) for _ in kinds)
    return [
        Fault(
            kind=kind,
            after=count,
            delay_s=rng.uniform(0.0, 1.0),
            pick=rng.random(),
            duration_s=math.exp(rng.uniform(math.log(SHORTEST_S), math.log(longest_s))),
        )
        for kind, count in zip(kinds, after, strict=True)
    ]


def bring_about(site: DataSite, fault: Fault) -> Trace:
    """Let a fault happen."""
    try:
        return ACTIONS[fault.kind](site, fault)
    except (ProcessLookupError, FileNotFoundError) as error:
        return _nothing(f"gone meanwhile: {error}")


def _nothing(words: str) -> Trace:
    return Trace(words=words, skipped=True, later=True)


def _workers(site: DataSite) -> list[tuple[str, int]]:
    return sorted((name, pid) for name, pid in site.processes().items() if name != LAUNCHER)


def _kill(site: DataSite, fault: Fault) -> Trace:
    workers = _workers(site)
    count = 2 if fault.kind is Kind.KILL_TWO else 1
    if len(workers) < count:
        return _nothing("no worker is there")
    first = int(fault.pick * len(workers))
    chosen = [workers[(first + step) % len(workers)] for step in range(count)]
    for _, pid in chosen:
        os.kill(pid, signal.SIGKILL)
    return Trace(words=", ".join(name for name, _ in chosen))


def _freeze(site: DataSite, fault: Fault) -> Trace:
    workers = _workers(site)
    if fault.kind is Kind.FREEZE_ROUTER:
        workers = [(LAUNCHER, pid) for name, pid in site.processes().items() if name == LAUNCHER]
    if not workers:
        return _nothing("no process is there")
    name, pid = workers[int(fault.pick * len(workers))]
    os.kill(pid, signal.SIGSTOP)

    def go_on() -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    return Trace(words=f"{name}, {fault.duration_s:.1f} s", undo=go_on)


def _end_launcher(site: DataSite, fault: Fault) -> Trace:
    number = signal.SIGTERM if fault.kind is Kind.END_LAUNCHER else signal.SIGKILL
    site.end(number)
    if fault.kind is Kind.LOSE_LEDGER:
        for file in site.folder.state.glob("ledger*"):
            file.unlink()
    return Trace(words=number.name)


def _lose_disk(site: DataSite, fault: Fault) -> Trace:
    own = own_folders(site.folder.path)
    if not own:
        return Trace(words="no recorder has a separate disk any more", skipped=True)
    name, place = sorted(own.items())[0]
    site.end(signal.SIGKILL)
    # The recorder writes on for a moment, as onto a disk that is pulled out.
    lost = place.rename(place.with_name(f"{place.name}-lost"))
    while not _given_up(site, name):
        time.sleep(0.2)
    shutil.rmtree(lost, ignore_errors=True)
    return Trace(words=name)


def _given_up(site: DataSite, recorder: str) -> bool:
    """Give a recorder up as soon as the command that began the run lets go of the folder."""
    try:
        with site.folder.lock():
            requeue(site.folder, recorder)
    except RunError as error:
        if "Another process" not in str(error):
            raise
        return False
    return True


def _damage(path: Path, fault: Fault) -> Trace:
    """Change a byte of a file, in whose length nothing changes."""
    size = path.stat().st_size
    if not size:
        return _nothing(f"{path.name} is empty")
    offset = int((fault.pick * 7919 % 1.0) * size)
    with path.open("r+b") as file:
        file.seek(offset)
        byte = file.read(1)[0]
        file.seek(offset)
        file.write(bytes([byte ^ 0x10]))
    return Trace(words=f"{path.name}, byte {offset} of {size}")


def _chosen(paths: list[Path], fault: Fault) -> Path | None:
    return paths[int(fault.pick * len(paths))] if paths else None


def _damage_blob(site: DataSite, fault: Fault) -> Trace:
    path = _chosen(sorted(site.folder.blobs.glob("[0-9a-f]*")), fault)
    return _damage(path, fault) if path else _nothing("no result is there")


def _damage_shard(site: DataSite, fault: Fault) -> Trace:
    path = _chosen(site.shards(), fault)
    if path is None:
        return _nothing("no shard is there")
    if fault.kind is Kind.DAMAGE_SHARD:
        return _damage(path, fault)
    if fault.kind is Kind.LOSE_SHARD:
        path.unlink()
        return Trace(words=path.name)
    size = path.stat().st_size
    os.truncate(path, int(size * fault.pick))
    return Trace(words=f"{path.name} to {int(size * fault.pick)} of {size} bytes")


def _fill_disk(site: DataSite, fault: Fault) -> Trace:
    folder = site.folder.path
    if not os.path.ismount(folder):
        return Trace(words="the data folder is not on a separate small disk", skipped=True)
    ballast = folder / ".readygo" / "ballast"
    with contextlib.suppress(OSError), ballast.open("wb") as file:
        _take_all(file.fileno())
    return Trace(words=f"{fault.duration_s:.1f} s", undo=lambda: ballast.unlink(missing_ok=True))


def _take_all(descriptor: int) -> None:
    """Give a file all room that its disk has left, while others take some as well."""
    end = 0
    for block in (2**26, 2**20, 2**12):
        with contextlib.suppress(OSError):
            while True:
                os.posix_fallocate(descriptor, end, block)
                end += block


def _take_names(site: DataSite, fault: Fault) -> Trace:
    """Have processes come and go that are called as the fleet's, in roles that these have not."""
    try:
        bus = site.join()
        workers = bus.request(topics.FLEET, FleetRequest(), timeout_s=1.0).workers
    except ReadygoError as error:
        return _nothing(str(error))
    bus.close()
    roles = sorted({*(worker.role for worker in workers), "stranger"})
    for worker in workers:
        guest = site.join()
        for role in roles:
            if role != worker.role:
                guest.announce(role, worker.name)
        guest.close()
    return Trace(words=f"{len(workers)} names in {len(roles)} roles")


def _lie(site: DataSite, fault: Fault) -> Trace:
    if not site.durable():
        return _nothing("no worker has said yet of which numeric class the run is")
    try:
        bus = site.join()
    except ReadygoError as error:
        return _nothing(str(error))
    try:
        bus.request(topics.STATUS, StatusRequest(), timeout_s=1.0)
        return Trace(words=send_lies(bus, site.folder.load()[0], random.Random(fault.pick)))
    except BusError as error:
        return _nothing(str(error))
    finally:
        bus.close()


ACTIONS: Mapping[Kind, Callable[[DataSite, Fault], Trace]] = {
    Kind.KILL: _kill,
    Kind.KILL_TWO: _kill,
    Kind.FREEZE: _freeze,
    Kind.FREEZE_ROUTER: _freeze,
    Kind.KILL_LAUNCHER: _end_launcher,
    Kind.END_LAUNCHER: _end_launcher,
    Kind.DAMAGE_BLOB: _damage_blob,
    Kind.DAMAGE_SHARD: _damage_shard,
    Kind.CUT_SHARD: _damage_shard,
    Kind.LOSE_SHARD: _damage_shard,
    Kind.LOSE_LEDGER: _end_launcher,
    Kind.LOSE_DISK: _lose_disk,
    Kind.FULL_DISK: _fill_disk,
    Kind.HOSTILE: _lie,
    Kind.TWICE_NAMED: _take_names,
}
