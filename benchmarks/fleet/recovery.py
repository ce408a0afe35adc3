"""How fast a fleet starts and recovers: `python -m readygo.benchmarks.fleet.recovery [--repeats 5] [--json]`.

A run of the embedded scene with small images continues while its processes are killed and stopped. Wall times depend on
what else the machine does: the fastest and the median of the repeats are given, and beside the time until a process is
ready its processor time, which does not.
"""

import contextlib
import json
import os
import signal
import statistics
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import tyro

from readygo.apps.fleet.roles import COORDINATOR
from readygo.benchmarks.fleet.chaos import SETTINGS
from readygo.benchmarks.fleet.site import DataSite
from readygo.benchmarks.rasterizer.render import machine
from readygo.benchmarks.recording.watching import cpu_s
from readygo.common.bus import Bus, Member
from readygo.common.errors import BusError, ReadygoError
from readygo.common.messages import CommittedEpisode, StatusRequest, topics
from readygo.runs.folder import RunFolder

ASKED_S = {
    "ready": 2.0,
    "coordinator kill -> commit": 3.0,
    "recorder kill -> commit": 3.0,
    "worker kill -> leased again": 0.3,
    "silent host -> requeued": 2.5,
}
"""What a quiet machine of two cores shall keep [s]."""
POLL_S = 0.01
PATIENCE_S = 180.0
LEASELESS_S = 5.0
"""A worker that is gone or stopped for so long, and nothing is requeued, held no lease [s]."""
EPISODES = 100_000
"""More than will be recorded: the run is stopped when all is measured."""


class RunObserver:
    """What a process that has joined the run observes."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.came_s: dict[str, float] = {}
        """When a worker last said that it is there, by name."""
        self.committed_s = 0.0
        """When the latest episode became durable."""
        self._news = threading.Condition()
        bus.watch(self._changed)
        bus.subscribe(topics.COMMITTED, self._committed)

    def until(self, holds: Callable[[], bool]) -> float:
        """Wait until something holds; returns when it did.

        Raises:
            TimeoutError: If that takes too long.
        """
        with self._news:
            if not self._news.wait_for(holds, PATIENCE_S):
                raise TimeoutError(f"Nothing happens for {PATIENCE_S:g} s.")
        return time.monotonic()

    def count_requeued(self) -> tuple[int, int]:
        """Leases that ended without a result so far, and the episodes that are leased."""
        try:
            status = self.bus.request(topics.STATUS, StatusRequest(), timeout_s=1.0)
        except BusError:
            return -1, 0
        return status.requeued, sum(status.leased.values())

    def _changed(self, member: Member, alive: bool) -> None:
        with self._news:
            if alive:
                self.came_s[member.name] = time.monotonic()
            self._news.notify_all()

    def _committed(self, episode: CommittedEpisode) -> None:
        with self._news:
            self.committed_s = time.monotonic()
            self._news.notify_all()


def main(
    *,
    repeats: int = 5,
    workers: int = 2,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        repeats: Times that each thing happens.
        workers: Renderers.
        json_output: Print JSON.
    """
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "settings.toml").write_text(SETTINGS)
        command = ["generate", "embedded", "--episodes", str(EPISODES), "--workers", str(workers)]
        command += ["--config", f"{place}/settings.toml", "--out", f"{place}/data"]
        site = DataSite(command, RunFolder(Path(place) / "data"), Path(place) / "fleet.log")
        site.start()
        try:
            found = measure(site, repeats)
        finally:
            site.stop()
    result = {"machine": machine(), "load": os.getloadavg()[0], "repeats": repeats, "rows": found}
    print(json.dumps(result) if json_output else _text(result))


def measure(site: DataSite, repeats: int) -> dict[str, dict[str, float]]:
    """All rows, by name: fastest and median [s]."""
    watch = _join(site)
    try:
        return _measure(site, watch, repeats)
    finally:
        # While the router is there: a session that is left open keeps the process from ending.
        watch.bus.close()


def _measure(site: DataSite, watch: RunObserver, repeats: int) -> dict[str, dict[str, float]]:
    watch.until(lambda: watch.committed_s > 0.0)
    times: dict[str, list[float]] = {}

    def note(name: str, value: float) -> None:
        times.setdefault(name, []).append(value)

    for _ in range(repeats):
        for name in sorted(site.processes().keys() - {"launcher"}):
            for row, value in _kill(site, watch, name).items():
                note(row, value)
        note("silent host -> requeued", _silent(site, watch))
    return {
        name: {"best": round(min(values), 3), "median": round(statistics.median(values), 3), "count": len(values)}
        for name, values in times.items()
    }


def _join(site: DataSite) -> RunObserver:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return RunObserver(site.join())
        except ReadygoError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.2)


def _kill(site: DataSite, watch: RunObserver, name: str) -> dict[str, float]:
    """Kill a process; when its successor is ready, and what else is waited for."""
    pid, before = site.processes()[name], watch.count_requeued()[0]
    begin_s = time.monotonic()
    os.kill(pid, signal.SIGKILL)
    rows: dict[str, float] = {}
    role = name.rstrip("0123456789")
    if role not in (COORDINATOR, "rec"):
        rows |= _requeued(watch, before, begin_s)
    watch.until(lambda: watch.came_s.get(name, 0.0) > begin_s)
    # It may have come while the end of a lease was waited for.
    ready_s = watch.came_s[name]
    successor = site.processes().get(name)
    if successor:
        rows[f"ready: {role}"] = ready_s - _started_s(successor)
        rows[f"ready: {role}, processor time"] = cpu_s(successor)
    if role in (COORDINATOR, "rec"):
        what = COORDINATOR if role == COORDINATOR else "recorder"
        since_s = ready_s if role == COORDINATOR else begin_s
        rows[f"{what} kill -> commit"] = watch.until(lambda: watch.committed_s > since_s) - begin_s
    else:
        watch.until(lambda: watch.committed_s > ready_s)
    return rows


def _requeued(watch: RunObserver, before: int, begin_s: float) -> dict[str, float]:
    """When the lease of a worker that was killed ended; nothing if it held none."""
    while time.monotonic() - begin_s < LEASELESS_S:
        if before >= 0 and watch.count_requeued()[0] > before:
            return {"worker kill -> lease free": time.monotonic() - begin_s}
        time.sleep(POLL_S)
    return {}


def _silent(site: DataSite, watch: RunObserver) -> float:
    """Stop a renderer that holds a lease, as if its host were unplugged: when its lease ends."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if row := _stopped(site, watch):
            return row
        # It held none; the next one may.
    raise TimeoutError(f"No renderer that holds a lease was met in {PATIENCE_S:g} s.")


def _stopped(site: DataSite, watch: RunObserver) -> float | None:
    pid = next(pid for name, pid in site.processes().items() if name.startswith("renderer"))
    before, begin_s = watch.count_requeued()[0], time.monotonic()
    os.kill(pid, signal.SIGSTOP)
    try:
        while watch.count_requeued()[0] <= before and time.monotonic() - begin_s < LEASELESS_S:
            time.sleep(POLL_S)
        held_s = time.monotonic() - begin_s
        return held_s if held_s < LEASELESS_S else None
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def _started_s(pid: int) -> float:
    """When a process began, by the clock of `time.monotonic`."""
    ticks = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19])
    return ticks / os.sysconf("SC_CLK_TCK") + time.monotonic() - time.clock_gettime(time.CLOCK_BOOTTIME)


def _text(result: dict[str, Any]) -> str:
    lines = [f"{result['repeats']} repeats, load {result['load']:.1f} on {result['machine']['cores']} cores"]
    lines.append(f"{'':44} {'best':>7} {'median':>7} {'asked':>7}  [s]")
    for name, row in result["rows"].items():
        asked = next((f"{limit:7.1f}" for key, limit in ASKED_S.items() if name.startswith(key)), "")
        lines.append(f"{name:44} {row['best']:7.2f} {row['median']:7.2f} {'' if 'processor' in name else asked:>7}")
    return "\n".join(lines)


if __name__ == "__main__":
    tyro.cli(main)
