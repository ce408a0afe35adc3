import hashlib
import threading
from collections.abc import Iterator

import pytest

from readygo.common.bus import InProcessBus, StageResult, leases, pull
from readygo.common.bus.leases import fetch_blob
from readygo.common.errors import BusError, RunError
from readygo.common.messages import (
    BlobReply,
    BlobRequest,
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


def test_lease_is_renewed_well_before_its_end_and_no_more_once_the_work_is_done() -> None:
    lease = ClaimReply(status="lease", episode=EPISODE, attempt=7, ttl_s=1.5)
    bus = InProcessBus()
    renewals: list[RenewRequest] = []
    renewed = threading.Event()

    def renew(request: RenewRequest) -> Verdict:
        renewals.append(request)
        renewed.set()
        return Verdict(status="ok")

    replies = iter([lease, ClaimReply(status="done")])
    bus.serve("coord/animate/claim", ClaimRequest, lambda _: next(replies))
    bus.serve("coord/animate/complete", CompleteRequest, lambda _: Verdict(status="ok"))
    bus.serve("coord/animate/renew", RenewRequest, renew)

    def work(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult:
        assert renewed.wait(claim.ttl_s), "the lease ended while the work went on"
        return StageResult()

    pull(bus, Stage.ANIMATE, "w", "", work, stop=threading.Event())
    assert [(r.worker, r.index, r.attempt) for r in renewals] == [("w", EPISODE.index, 7)]
    assert not [thread for thread in threading.enumerate() if thread.name == "renew"]


def _blobs(data: bytes, size: int | None = None, part: int = 4) -> InProcessBus:
    """A bus that hands out `data` for whatever hash is asked for, in parts."""
    bus = InProcessBus()

    def read(request: BlobRequest) -> BlobReply:
        end = request.offset + part
        return BlobReply(size=len(data) if size is None else size, data=data[request.offset : end])

    bus.serve("blob", BlobRequest, read)
    return bus


def test_blob_comes_whole_in_parts() -> None:
    data = b"0123456789"
    assert fetch_blob(_blobs(data), hashlib.sha256(data).hexdigest()) == data


@pytest.mark.parametrize(("data", "size"), [(b"0123456780", None), (b"01234567", 10)])
def test_damaged_or_shortened_blob_is_refused(data: bytes, size: int | None) -> None:
    with pytest.raises(RunError, match="arrived damaged"):
        fetch_blob(_blobs(data, size), hashlib.sha256(b"0123456789").hexdigest())


def test_unknown_blob_is_refused() -> None:
    with pytest.raises(RunError, match="not known"):
        fetch_blob(_blobs(b"", -1), "0" * 64)
