"""Status of a run as tables for a terminal: stages, workers, disks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from readygo.common.bus import Bus
from readygo.common.messages import StatusReply, StatusRequest, topics
from readygo.common.messages.fleet import FleetReply, FleetRequest, WorkerState
from readygo.common.messages.live import LiveHealth

SILENT_S = 10.0
"""Time without a renewal after which a worker with a lease counts as silent [s]; workers renew every 5 s by default."""
DISK_LOW = 0.05
"""Share of free space below which a disk counts as nearly full."""
REASONS_MAX = 10
Who = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Status of a run with the resource use of its processes."""

    status: StatusReply
    fleet: FleetReply
    healths: Mapping[Who, LiveHealth] = field(default_factory=dict)
    """Newest resource use of each process, by role and name."""
    cpu: Mapping[Who, float] = field(default_factory=dict)
    """Cores in use between the two newest messages, by role and name."""


class RunStatus:
    """Subscribes to the resource use of a run's processes, and requests the status of its coordinator."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._healths: dict[Who, LiveHealth] = {}
        self._cpu: dict[Who, float] = {}
        bus.subscribe(topics.HEALTH.of(), self._hear)

    def now(self) -> Observed:
        """The current status.

        Raises:
            BusError: If the coordinator does not answer.
        """
        return Observed(
            status=self._bus.request(topics.STATUS, StatusRequest()),
            fleet=self._bus.request(topics.FLEET, FleetRequest()),
            healths=dict(self._healths),
            cpu=dict(self._cpu),
        )

    def _hear(self, health: LiveHealth) -> None:
        who = health.role, health.name
        before = self._healths.get(who)
        if before is not None and before.pid == health.pid and health.uptime_s > before.uptime_s:
            self._cpu[who] = (health.cpu_s - before.cpu_s) / (health.uptime_s - before.uptime_s)
        self._healths[who] = health


def status_table(observed: Observed) -> RenderableType:
    """A summary of the run, a table of its stages and one of its processes."""
    return Group(_summary(observed), _stages(observed), _workers(observed))


def runs_table(runs: Sequence[StatusReply]) -> RenderableType:
    """A table with a row for each run of a router."""
    if not runs:
        return Text("No run is led there.")
    table = _table("run", "priority", "episodes", "samples", "at work", "does")
    for status in runs:
        episodes = f"{status.committed} of {status.wanted}"
        counts = (str(status.samples), str(sum(status.leased.values())))
        table.add_row(status.run, str(status.priority), episodes, *counts, _state(status))
    return table


def _state(status: StatusReply) -> Text:
    """State of a run in few words."""
    if status.failed:
        return Text(f"ended: {status.failed}", "red")
    if status.finished:
        return Text("is over")
    if status.paused:
        return Text("paused", "yellow")
    return Text(f"waits: {status.trouble}", "yellow") if status.trouble else Text("running")


def left_s(observed: Observed) -> float | None:
    """Time until the run is over at the rate of the last minute [s]; None if nothing was recorded in it."""
    status = observed.status
    per_minute = observed.fleet.done_per_minute.get(observed.fleet.stages[-1], 0.0)
    return 60.0 * (status.wanted - status.committed) / per_minute if per_minute else None


def _summary(observed: Observed) -> Text:
    status, left = observed.status, left_s(observed)
    text = Text(f"{status.committed} of {status.wanted} episodes, {status.samples} samples")
    if left is not None and not status.finished:
        text.append(f", about {duration(left)} left")
    if status.paused:
        text.append("; paused, `readygo resume` continues", "yellow")
    for words, counts in (("rejected", status.rejected), ("kept", status.kept)):
        for reason, count in list(counts.items())[:REASONS_MAX]:
            text.append(f"\n  {words} {count}: {reason}")
    text.append(f"\n  leases that ended without a result: {status.requeued}" if status.requeued else "")
    text.append(f"\n  policies offered: {status.policies}" if status.policies else "")
    text.append(f"\n  waits: {status.trouble}" if status.trouble else "", "yellow")
    text.append(f"\n  ended: {status.failed}" if status.failed else "", "red")
    return text


def _stages(observed: Observed) -> Table:
    status, fleet = observed.status, observed.fleet
    table = _table("stage", "waiting", "at work", "a minute", "CPU [s]")
    for stage in fleet.stages:
        table.add_row(
            stage,
            str(status.waiting.get(stage, 0)),
            str(status.leased.get(stage, 0)),
            f"{fleet.done_per_minute.get(stage, 0.0):.1f}",
            f"{status.cpu_s.get(stage, 0.0):.1f}",
        )
    return table


def _workers(observed: Observed) -> Table:
    table = _table("worker", "does", "done", "failed", "cores", "memory", "disk free", "metrics")
    for worker in observed.fleet.workers:
        who = worker.role, worker.name
        health, cores = observed.healths.get(who), observed.cpu.get(who)
        table.add_row(
            worker.name,
            _does(worker),
            str(worker.done or ""),
            Text(str(worker.failed or ""), "yellow"),
            "" if cores is None else f"{cores:.2f}",
            f"{health.memory_bytes / 1e6:.0f} MB" if health else "",
            _disk(health) if health and health.disk_size_bytes else "",
            health.metrics if health else "",
        )
    return table


def _does(worker: WorkerState) -> Text:
    """Current work of a process, and its trouble if there is one."""
    held = ", ".join(f"{lease.stage} {lease.index} for {duration(lease.held_s)}" for lease in worker.holds)
    if not worker.role:
        return Text(f"gone, holds {held}", "red")
    if worker.holds and worker.silent_s > SILENT_S:
        return Text(f"silent for {duration(worker.silent_s)}, holds {held}", "red")
    return Text(held)


def _disk(health: LiveHealth) -> Text:
    low = health.disk_free_bytes < DISK_LOW * health.disk_size_bytes
    return Text(f"{health.disk_free_bytes / 1e9:.1f} GB", "red" if low else "")


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(column, justify="left" if column in ("stage", "worker", "run", "does", "metrics") else "right")
    return table


def duration(seconds: float) -> str:
    """A duration in words, in a suitable unit."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
