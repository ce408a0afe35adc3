import threading
from collections.abc import Iterator

import pytest

from readygo.common.bus import InProcessBus, StageResult, leases, pull
from readygo.common.errors import BusError
from readygo.common.messages import (
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    EpisodeKey,
    RenewRequest,
    Split,
    Stage,
    Verdict,
)

EPISODE = EpisodeKey(seed=0, split=Split.TRAIN, index=0)


class Clock:
    """Stands in for `time.monotonic`."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(leases.time, "monotonic", clock)
    return clock


def _bus(claims: Iterator[ClaimReply | BusError], completed: list[CompleteRequest]) -> InProcessBus:
    bus = InProcessBus()

    def claim(_: ClaimRequest) -> ClaimReply:
        reply = next(claims)
        if isinstance(reply, BusError):
            raise reply
        return reply

    def complete(request: CompleteRequest) -> Verdict:
        completed.append(request)
        return Verdict(status="ok")

    bus.serve("coord/animate/claim", ClaimRequest, claim)
    bus.serve("coord/animate/complete", CompleteRequest, complete)
    bus.serve("coord/animate/renew", RenewRequest, lambda _: Verdict(status="ok"))
    return bus


def test_long_work_does_not_count_as_the_coordinators_absence(clock: Clock) -> None:
    lease = ClaimReply(status="lease", episode=EPISODE, attempt=1, ttl_s=15.0)
    claims = iter([lease, BusError("away"), lease, BusError("away"), ClaimReply(status="done")])
    completed: list[CompleteRequest] = []

    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult:
        clock.now_s += 10 * leases.COORDINATOR_ABSENT_S
        return StageResult(result=b"x")

    pull(_bus(claims, completed), Stage.ANIMATE, "w", "", work, stop=threading.Event())
    assert [request.result for request in completed] == [b"x", b"x"]


def test_coordinator_that_stays_away_ends_the_worker(clock: Clock) -> None:
    def away() -> Iterator[BusError]:
        while True:
            clock.now_s += 25.0
            yield BusError("Nobody answered")

    stop = threading.Event()
    stop.wait = lambda timeout=None: False  # type: ignore[method-assign]
    with pytest.raises(BusError, match="Nobody answered"):
        pull(_bus(away(), []), Stage.ANIMATE, "w", "", lambda *_: None, stop=stop)
    assert clock.now_s == 100.0
