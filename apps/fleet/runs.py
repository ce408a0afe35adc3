"""The runs of a router, as their coordinators tell of them, and which one a worker does next."""

import hashlib
import re
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.fleet.access import join
from readygo.common.bus import Bus
from readygo.common.bus.identity import ALL, RECORDER
from readygo.common.messages import StatusReply, topics
from readygo.common.messages.stages import STAGES

ANY_RUN = "*"
"""In place of a run's name: who only listens hears all runs of a router."""
FRESH_S = 5.0
"""Coordinators tell how far their run is once a second; one that is silent for so long gives out no work [s]."""
STEADY_S = 2.0
"""A worker leaves a run when it has had nothing to do for so long, or a more urgent one something [s]."""
BARRED_S = 60.0
"""A run that a worker cannot take part in is tried again after so long [s]."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
HEAR_S = 1.5
"""Time in which every coordinator tells of its run at least once [s]."""


@dataclass
class _Heard:
    """What is known of a run."""

    status: StatusReply
    told_s: float
    has_work: bool
    since_s: float
    """Since when it has had work, or none."""


class Runs:
    """Hears of the runs of a router, and says which of them a worker shall do."""

    def __init__(
        self,
        bus: Bus,
        *,
        role: str = ALL,
        me: str = "",
        named: Collection[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to listen.

        Args:
            bus: One that hears all runs, see `ANY_RUN`.
            role: What the worker does.
            me: Its name: of runs that are equally urgent, different workers prefer different ones.
            named: Runs that it is meant for; none named stands for all.
            clock: Time [s].
        """
        self._stages = {stage.name for stage in STAGES if stage.role == role}
        self.named = frozenset(named)
        self._role, self._me, self._clock = role, me, clock
        self._heard: dict[str, _Heard] = {}
        self._barred_s: dict[str, float] = {}
        self._over: set[str] = set()
        self._lock = threading.Lock()
        self.heard_s = clock()
        """When one of the runs that it is meant for was heard last."""
        bus.subscribe(topics.PROGRESS, self._hear)

    def statuses(self) -> list[StatusReply]:
        """Of the runs that are heard of, the most urgent first."""
        now_s = self._clock()
        with self._lock:
            found = [heard.status for heard in self._heard.values() if now_s - heard.told_s < FRESH_S]
        return sorted(found, key=lambda status: (-status.priority, status.run))

    @property
    def over(self) -> bool:
        """True when all runs that were named have ended."""
        return bool(self.named) and self.named <= self._over

    def open(self) -> list[str]:
        """Names of the runs that are not over."""
        return [status.run for status in self._of_mine() if not _is_over(status)]

    def choose(self) -> str:
        """The run to do now: of the most urgent ones that have work the one that fewest work on; empty for none."""
        return min((self._rank(status) for status in self._of_mine() if self._has_work(status)), default=("",))[-1]

    def better_than(self, run: str) -> bool:
        """True if a worker of `run` shall leave it for another one."""
        now_s = self._clock()
        with self._lock:
            own, heard = self._heard.get(run), dict(self._heard)
        urgent = [
            other.status.priority
            for name, other in heard.items()
            if name != run
            and self._is_mine(other.status)
            and other.has_work
            and now_s - other.told_s < FRESH_S
            and now_s - other.since_s >= STEADY_S
        ]
        if not urgent or own is None:
            return False
        silent = now_s - own.told_s >= FRESH_S
        idle = silent or (not own.has_work and now_s - own.since_s >= STEADY_S)
        return idle or max(urgent) > own.status.priority

    def bar(self, run: str) -> None:
        """Leave a run alone for a while."""
        self._barred_s[run] = self._clock() + BARRED_S

    def left(self, run: str, *, over: bool) -> None:
        """A run was left, perhaps because it is over: should there be more to do, its coordinator says so."""
        with self._lock:
            self._heard.pop(run, None)
            if over:
                self._over.add(run)

    def _hear(self, status: StatusReply) -> None:
        now_s, has_work = self._clock(), self._has_work(status)
        with self._lock:
            before = self._heard.get(status.run)
            since_s = before.since_s if before and before.has_work == has_work else now_s
            self._heard[status.run] = _Heard(status, now_s, has_work, since_s)
            if self._is_mine(status):
                self.heard_s = now_s
                (self._over.add if _is_over(status) else self._over.discard)(status.run)

    def _of_mine(self) -> list[StatusReply]:
        return [status for status in self.statuses() if self._is_mine(status)]

    def _is_mine(self, status: StatusReply) -> bool:
        barred = self._clock() < self._barred_s.get(status.run, 0.0)
        # Another version may not say which run it is, and a name is a folder's as well.
        return bool(_NAME.fullmatch(status.run)) and not barred and (not self.named or status.run in self.named)

    def _has_work(self, status: StatusReply) -> bool:
        if status.paused or _is_over(status):
            return False
        counts = status.waiting.items()
        return any(count for stage, count in counts if self._role in (ALL, RECORDER) or stage in self._stages)

    def _rank(self, status: StatusReply) -> tuple[int, int, str, str]:
        mine = hashlib.sha256(f"{self._me} {status.run}".encode()).hexdigest()
        return -status.priority, sum(status.leased.values()), mine, status.run


def _is_over(status: StatusReply) -> bool:
    return status.finished or bool(status.failed)


def runs_at(connect: str, role: str, *, certs: Path | None = None, token: str | None = None) -> list[StatusReply]:
    """The runs that a router has, the most urgent first.

    Args:
        connect: Its endpoint.
        role: Whose certificate is shown.
        certs: Folder of certificates.
        token: See `join`.

    Raises:
        CertificateError: As `join`.
        BusError: If nobody answers there.
    """
    bus = join(connect, ANY_RUN, role, certs=certs, token=token)
    try:
        runs = Runs(bus)
        time.sleep(HEAR_S)
        return runs.statuses()
    finally:
        bus.close()


def none_such(run: str, connect: str, there: list[StatusReply]) -> str:
    """Why nobody answers for a run, in a line."""
    names = ", ".join(status.run for status in there)
    return f"Nobody leads run {run} at {connect} ({f'there: {names}' if names else 'there is no run'})."
