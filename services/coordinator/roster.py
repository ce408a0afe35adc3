"""Who is there, when they were last heard, what they have done lately; lost when the coordinator ends."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable

from readygo.common.bus.identity import ALL
from readygo.common.messages.fleet import HeldLease, WorkerState

RECENT_S = 60.0
"""What was done within this time makes up the rates [s]."""
Held = tuple[str, str, int, int]
"""Worker, stage, index and attempt of a lease."""


class Roster:
    """The coordinator's own notes; used on one thread, read from any."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._begin_s = clock()
        self._present: dict[str, str] = {}
        self._heard_s: dict[str, float] = {}
        self._leased_s: dict[int, tuple[int, float]] = {}
        self._absent_s: dict[str, float] = {}
        self._done: Counter[str] = Counter()
        self._failed: Counter[str] = Counter()
        self._recent: deque[tuple[float, str]] = deque()

    def note_presence(self, role: str, name: str, *, alive: bool) -> None:
        """A process came, or is gone."""
        if alive:
            self._present[name] = role
        else:
            self._present.pop(name, None)
            self._heard_s.pop(name, None)

    @property
    def size(self) -> int:
        """Processes that are there."""
        return len(self._present)

    def absent_s(self, stage: str, role: str, *, needed: bool) -> float:
        """For how long a stage that is needed has had nobody who does it [s]; asked for now and then."""
        there = any(other in (role, ALL) for other in tuple(self._present.values()))
        if there or not needed:
            self._absent_s.pop(stage, None)
            return 0.0
        return self._clock() - self._absent_s.setdefault(stage, self._clock())

    def note_heard(self, worker: str) -> None:
        """A worker said something; names of nobody who is there are not kept."""
        if worker in self._present:
            self._heard_s[worker] = self._clock()

    def note_lease(self, index: int, attempt: int) -> None:
        """A lease began."""
        self._leased_s[index] = attempt, self._clock()

    def note_done(self, worker: str, stage: str, index: int, *, failed: bool) -> None:
        """A lease ended with a result, or an error."""
        self._leased_s.pop(index, None)
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
        held: dict[str, list[HeldLease]] = {name: [] for name in tuple(self._present)}
        for worker, stage, index, attempt in leases:
            known, since_s = self._leased_s.get(index, (0, self._begin_s))
            since_s = since_s if known == attempt else self._begin_s
            lease = HeldLease(stage=stage, index=index, attempt=attempt, held_s=now_s - since_s)
            held.setdefault(worker, []).append(lease)
        found = (
            WorkerState(
                role=self._present.get(name, ""),
                name=name,
                silent_s=now_s - self._heard_s.get(name, self._begin_s),
                done=self._done[name],
                failed=self._failed[name],
                holds=tuple(leases),
            )
            for name, leases in held.items()
        )
        return tuple(sorted(found, key=lambda worker: (worker.role, worker.name)))
