"""Processes that are present, when they were last heard and what they did lately; lost when the coordinator ends."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable

from readygo.common.bus.identity import ALL
from readygo.common.messages.fleet import HeldLease, WorkerState

RECENT_S = 60.0
"""What was done within this time makes up the rates [s]."""
WorkerKey = tuple[str, str]
"""Role and name of a worker: names differ within a role only."""
Held = tuple[str, str, str, int, int]
"""Role and name of the worker, stage, index and attempt of a lease."""


class Roster:
    """The coordinator's own notes; used on one thread, read from any."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._begin_s = clock()
        self._present: dict[WorkerKey, set[str]] = {}
        """Sessions of those who are there; more than one while a worker takes another one's place."""
        self._heard_s: dict[WorkerKey, float] = {}
        self._leased: dict[int, tuple[int, WorkerKey, float]] = {}
        """Attempt, worker and beginning of a lease, by index."""
        self._absent_s: dict[str, float] = {}
        self._done: Counter[WorkerKey] = Counter()
        self._failed: Counter[WorkerKey] = Counter()
        self._recent: deque[tuple[float, str]] = deque()

    def note_presence(self, role: str, name: str, session: str = "", *, alive: bool) -> bool:
        """A process came, or is gone; returns whether any process of this role and name is there now."""
        sessions = self._present.setdefault((role, name), set())
        if alive:
            sessions.add(session)
        else:
            sessions.discard(session)
        if not sessions:
            del self._present[role, name]
            self._heard_s.pop((role, name), None)
        return bool(sessions)

    @property
    def size(self) -> int:
        """Processes that are there."""
        return len(self._present)

    def absent_s(self, stage: str, role: str, *, needed: bool) -> float:
        """How long a needed stage has had no process that does it [s]; call it regularly."""
        there = any(other in (role, ALL) for other, _ in tuple(self._present))
        if there or not needed:
            self._absent_s.pop(stage, None)
            return 0.0
        return self._clock() - self._absent_s.setdefault(stage, self._clock())

    def note_heard(self, role: str, name: str) -> None:
        """A worker said something; names of processes that are not there are not kept."""
        if (role, name) in self._present:
            self._heard_s[role, name] = self._clock()

    def note_lease(self, role: str, name: str, index: int, attempt: int) -> None:
        """Note that a lease began."""
        self._leased[index] = attempt, (role, name), self._clock()

    def note_renewed(self, index: int, attempt: int) -> None:
        """The holder of a lease said something of it."""
        known, worker, _ = self._leased.get(index, (0, ("", ""), 0.0))
        if known == attempt:
            self.note_heard(*worker)

    def note_done(self, stage: str, index: int, attempt: int, *, failed: bool) -> None:
        """A lease ended with a result, or an error."""
        self.note_renewed(index, attempt)
        known, worker, _ = self._leased.get(index, (0, ("", ""), 0.0))
        if known == attempt:
            del self._leased[index]
            if worker in self._present:
                (self._failed if failed else self._done)[worker] += 1
        if not failed:
            self._recent.append((self._clock(), stage))
        while self._recent and self._clock() - self._recent[0][0] > RECENT_S:
            self._recent.popleft()

    def done_per_minute(self) -> dict[str, float]:
        """Episodes that passed a stage lately, as a rate by stage."""
        now_s = self._clock()
        over_s = min(max(now_s - self._begin_s, 1.0), RECENT_S)
        counts = Counter(stage for done_s, stage in tuple(self._recent) if now_s - done_s <= RECENT_S)
        return {stage: 60.0 * count / over_s for stage, count in counts.items()}

    def workers(self, leases: Iterable[Held]) -> tuple[WorkerState, ...]:
        """All who are there or hold a lease, by role and name."""
        now_s = self._clock()
        present = set(self._present)
        held: dict[WorkerKey, list[HeldLease]] = {worker: [] for worker in present}
        for role, name, stage, index, attempt in leases:
            known, _, since_s = self._leased.get(index, (0, ("", ""), self._begin_s))
            since_s = since_s if known == attempt else self._begin_s
            lease = HeldLease(stage=stage, index=index, attempt=attempt, held_s=now_s - since_s)
            held.setdefault((role, name), []).append(lease)
        found = (
            WorkerState(
                role=worker[0] if worker in present else "",
                name=worker[1],
                silent_s=now_s - self._heard_s.get(worker, self._begin_s),
                done=self._done[worker],
                failed=self._failed[worker],
                holds=tuple(leases),
            )
            for worker, leases in held.items()
        )
        return tuple(sorted(found, key=lambda worker: (worker.role, worker.name)))
