"""The runs of a router, from their coordinators' status messages, and a worker's choice among them."""

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
"""Instead of a run's name: a client that only subscribes receives the messages of all runs of a router."""
FRESH_S = 5.0
"""Time without a status message, sent once a second, after which a run counts as without work [s]."""
STEADY_S = 2.0
"""Time without work in a run, or with work in a more urgent one, after which a worker leaves it [s]."""
BARRED_S = 60.0
"""Time after which a worker tries a run again that it could not take part in [s]."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
HEAR_S = 1.5
"""Time in which every coordinator sends its status at least once [s]."""


@dataclass
class _Heard:
    """Last known state of a run."""

    status: StatusReply
    told_s: float
    has_work: bool
    since_s: float
    """Time since which the run has had work, or none [s]."""


class Runs:
    """Tracks the runs of a router, and chooses the run that a worker works on."""

    def __init__(
        self,
        bus: Bus,
        *,
        role: str = ALL,
        me: str = "",
        named: Collection[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Subscribe to the runs' status.

        Args:
            bus: Bus that receives all runs' messages, joined as `ANY_RUN`.
            role: Role of the worker.
            me: Name of the worker: different workers prefer different runs of equal priority.
            named: Names of the runs to serve; empty for all.
            clock: Returns the current time [s].
        """
        self._stages = {stage.name for stage in STAGES if stage.role == role}
        self.named = frozenset(named)
        self._role, self._me, self._clock = role, me, clock
        self._heard: dict[str, _Heard] = {}
        self._barred_s: dict[str, float] = {}
        self._over: set[str] = set()
        self._lock = threading.Lock()
        self.heard_s = clock()
        """Time of the last status of a run to serve [s]."""
        bus.subscribe(topics.PROGRESS, self._hear)

    def statuses(self) -> list[StatusReply]:
        """Status of the known runs, highest priority first."""
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
        """The run to work on: highest priority with work, then fewest workers; empty if no run has work."""
        return min((self._rank(status) for status in self._of_mine() if self._has_work(status)), default=("",))[-1]

    def better_than(self, run: str) -> bool:
        """True if a worker of `run` should leave it for a different run."""
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
        """Ignore a run for `BARRED_S`."""
        self._barred_s[run] = self._clock() + BARRED_S

    def left(self, run: str, *, over: bool) -> None:
        """Note that the worker has left a run; a run that is over counts again once its coordinator reports work."""
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
        # Another version may omit the run's name, and the name becomes a folder's name.
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
    """Status of the runs of a router, highest priority first.

    Args:
        connect: Endpoint of the router.
        role: Role whose certificate is presented.
        certs: Folder of certificates.
        token: Token of the run, without certificates; the one of this process's environment by default.

    Raises:
        CertificateError: If endpoint and certificates do not fit together, or the certificate cannot be used.
        BusError: If no router answers at the endpoint.
    """
    bus = join(connect, ANY_RUN, role, certs=certs, token=token)
    try:
        runs = Runs(bus)
        time.sleep(HEAR_S)
        return runs.statuses()
    finally:
        bus.close()


def none_such(run: str, connect: str, there: list[StatusReply]) -> str:
    """Error text for a run without a coordinator, with the router's other runs."""
    names = ", ".join(status.run for status in there)
    return f"No coordinator leads run {run} at {connect} ({f'there: {names}' if names else 'there is no run'})."
