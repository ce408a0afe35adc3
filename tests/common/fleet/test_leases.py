import dataclasses
import hashlib
import threading
from collections.abc import Iterator

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import BusError, RunError
from readygo.common.fleet import Inputs, StageResult, Work, Worker, claim_any, leases, pull
from readygo.common.messages import (
    Blob,
    BlobReply,
    ClaimReply,
    ClaimRequest,
    ClaimStatus,
    CompleteRequest,
    EpisodeKey,
    RenewRequest,
    Split,
    Stage,
    Verdict,
    VerdictStatus,
    Wake,
    decode,
    encode,
    topics,
)
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN
from tests.clock import Clock

EPISODE = EpisodeKey(seed=0, split=Split.TRAIN, index=0)
PLAN = Blob(sha256="0" * 64, data=b"plan")
LEASE = ClaimReply(status=ClaimStatus.LEASE, episode=EPISODE, attempt=1, ttl_s=15.0, inputs=(PLAN,))


def _worker(work: Work, *more: tuple[Stage, Work]) -> Worker:
    return Worker(name="w", numeric_class="this", works={ANIMATE: work, **dict(more)})


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
        return Verdict(status=VerdictStatus.OK)

    bus.serve(topics.claim("animate"), claim)
    bus.serve(topics.complete("animate"), complete)
    bus.serve(topics.renew("animate"), lambda _: Verdict(status=VerdictStatus.OK))
    return bus


def test_long_work_does_not_count_as_the_coordinators_absence(clock: Clock) -> None:
    claims = iter([LEASE, BusError("away"), LEASE, BusError("away"), ClaimReply(status=ClaimStatus.DONE)])
    completed: list[CompleteRequest] = []

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult:
        clock.now_s += 10 * leases.COORDINATOR_ABSENT_S
        return StageResult(result=b"x")

    pull(_bus(claims, completed), _worker(work), leave=lambda: False)
    assert [request.result for request in completed] == [b"x", b"x"]


def test_coordinator_that_stays_away_ends_the_worker(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    def away() -> Iterator[BusError]:
        while True:
            clock.now_s += 25.0
            yield BusError("Nobody answered")

    monkeypatch.setattr(leases.time, "sleep", lambda _: None)
    with pytest.raises(BusError, match="Nobody answered"):
        pull(_bus(away(), []), _worker(lambda *_: None), leave=lambda: False)
    assert clock.now_s == 100.0


def test_work_gets_the_results_that_its_stage_needs_by_name() -> None:
    seen: list[Inputs] = []
    completed: list[CompleteRequest] = []
    bus = _bus(iter([LEASE]), completed)
    work = lambda claim, inputs: seen.append(inputs) or StageResult(result=b"moved")  # noqa: E731
    assert claim_any(bus, _worker(work)) is ClaimStatus.LEASE
    assert seen == [{"human-plan": b"plan"}]
    (request,) = completed
    assert (request.worker, request.index, request.attempt, request.result) == ("w", 0, 1, b"moved")


def test_next_stage_is_asked_only_where_the_one_before_has_nothing() -> None:
    asked: list[str] = []
    bus = _bus(iter([ClaimReply(status=ClaimStatus.WAIT), LEASE]), [])
    wait = ClaimReply(status=ClaimStatus.WAIT)
    bus.serve(topics.claim("human-plan"), lambda _: asked.append("human-plan") or wait)
    worker = _worker(lambda *_: StageResult(), (HUMAN_PLAN, lambda *_: StageResult()))
    assert claim_any(bus, worker) is ClaimStatus.WAIT
    assert asked == ["human-plan"]
    assert claim_any(bus, worker) is ClaimStatus.LEASE
    assert asked == ["human-plan"]


def test_worker_of_another_numeric_class_is_told_what_to_do() -> None:
    bus = _bus(iter([ClaimReply(status=ClaimStatus.REFUSED)]), [])
    with pytest.raises(RunError, match=r"another numeric class than this worker's \(this\)"):
        claim_any(bus, _worker(lambda *_: None))


def test_failing_work_is_reported_with_its_words() -> None:
    def fail(claim: ClaimReply, inputs: Inputs) -> StageResult:
        raise ValueError("no floor")

    completed: list[CompleteRequest] = []
    claim_any(_bus(iter([LEASE]), completed), _worker(fail))
    assert completed[0].failed == "ValueError: no floor"


def test_idle_worker_asks_when_it_is_woken_and_hardly_ever_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leases, "IDLE_S", 60.0)
    asked = threading.Semaphore(0)
    replies = iter([ClaimReply(status=ClaimStatus.WAIT), ClaimReply(status=ClaimStatus.DONE)])
    bus = InProcessBus()

    def claim(_: ClaimRequest) -> ClaimReply:
        asked.release()
        return next(replies)

    bus.serve(topics.claim("animate"), claim)
    worker = threading.Thread(target=pull, args=(bus, _worker(lambda *_: None)), kwargs={"leave": lambda: False})
    worker.start()
    assert asked.acquire(timeout=20.0)
    bus.publish(topics.WAKE, Wake(stages=("render",)))
    assert not asked.acquire(timeout=0.3)
    bus.publish(topics.WAKE, Wake(stages=("render", "animate")))
    worker.join(timeout=20.0)
    assert not worker.is_alive()
    bus.close()


def test_unanswered_input_is_no_failure_of_the_episode_but_a_refused_one_is() -> None:
    """What the coordinator does not answer says nothing of an episode; what cannot be had or read does."""
    lease = dataclasses.replace(LEASE, inputs=(Blob(sha256="0" * 64),))
    completed: list[CompleteRequest] = []
    bus = _bus(iter([lease, lease]), completed)
    with pytest.raises(BusError, match="No participant answered blob"):
        claim_any(bus, _worker(lambda *_: StageResult()))
    assert completed == []
    bus.serve(topics.BLOB, lambda _: BlobReply(size=-1, data=b""))
    claim_any(bus, _worker(lambda *_: StageResult()))
    assert completed[0].failed == f"Blob {'0' * 64} is not known to the run."


def test_input_that_cannot_be_decoded_is_a_failure_of_the_episode() -> None:
    completed: list[CompleteRequest] = []
    work = lambda claim, inputs: StageResult(result=encode(decode(ClaimReply, inputs["human-plan"])))  # noqa: E731
    claim_any(_bus(iter([LEASE]), completed), _worker(work))
    assert "is no ClaimReply" in completed[0].failed


def test_lease_is_renewed_well_before_its_end_and_no_more_once_the_work_is_done() -> None:
    lease = dataclasses.replace(LEASE, attempt=7, ttl_s=1.5)
    bus = _bus(iter([lease, ClaimReply(status=ClaimStatus.DONE)]), [])
    renewals: list[RenewRequest] = []
    renewed = threading.Event()

    def renew(request: RenewRequest) -> Verdict:
        renewals.append(request)
        renewed.set()
        return Verdict(status=VerdictStatus.OK)

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult:
        assert renewed.wait(claim.ttl_s), "the lease ended while the work went on"
        return StageResult()

    bus.serve(topics.renew("animate"), renew)
    pull(bus, _worker(work), leave=lambda: False)
    assert [(r.worker, r.index, r.attempt) for r in renewals] == [("w", EPISODE.index, 7)]
    assert not [thread for thread in threading.enumerate() if thread.name == "renew"]


def test_work_is_shown_as_it_begins_and_ends_and_reported_with_its_lease(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    shown: list[tuple[str, int, dict[str, object]]] = []
    times_s, at_work = iter([3.0, 5.5]), list[dict[str, object]]()
    monkeypatch.setattr(
        leases, "show_work", lambda bus, stage, claim, **said: shown.append((stage.name, claim.attempt, said))
    )
    monkeypatch.setattr(leases.time, "thread_time", lambda: next(times_s))
    working = leases.working
    monkeypatch.setattr(leases, "working", lambda **what: at_work.append(what) or working(**what))
    completed: list[CompleteRequest] = []
    lease = dataclasses.replace(LEASE, attempt=4, lease="proof")
    bus = _bus(iter([lease]), completed)

    def complete(request: CompleteRequest) -> Verdict:
        completed.append(request)
        return Verdict(status=VerdictStatus.STALE, reason="too late")

    bus.serve(topics.complete("animate"), complete)
    claim_any(bus, _worker(lambda *_: StageResult(result=b"r", rejected="fog")))
    wanted = CompleteRequest(
        worker="w", index=0, attempt=4, result=b"r", rejected="fog", failed="", cpu_s=2.5, lease="proof"
    )
    assert completed == [wanted]
    assert at_work == [{"stage": "animate", "episode": EPISODE.episode_id, "attempt": 4}]
    assert shown == [
        ("animate", 4, {"begins": True}),
        ("animate", 4, {"begins": False, "rejected": "fog", "failed": ""}),
    ]
    assert caplog.messages == [f"{EPISODE.episode_id}: result of attempt 4 is stale too late"]


def test_result_that_was_handed_over_elsewhere_is_empty_and_large_inputs_are_fetched() -> None:
    completed: list[CompleteRequest] = []
    fetched = Blob(sha256=hashlib.sha256(b"large").hexdigest())
    bus = _bus(iter([dataclasses.replace(LEASE, inputs=(fetched,))]), completed)
    bus.serve(topics.BLOB, lambda request: BlobReply(size=5, data=b"large"[request.offset :]))
    seen: list[Inputs] = []
    assert claim_any(bus, _worker(lambda claim, inputs: seen.append(dict(inputs)))) is ClaimStatus.LEASE
    assert seen == [{"human-plan": b"large"}]
    assert (completed[0].result, completed[0].rejected, completed[0].failed) == (b"", "", "")


def test_run_that_is_over_is_no_reason_to_ask_for_the_next_stage() -> None:
    bus = _bus(iter([]), [])
    bus.serve(topics.claim("human-plan"), lambda _: ClaimReply(status=ClaimStatus.WAIT))
    done = ClaimReply(status=ClaimStatus.DONE)
    bus.serve(topics.claim("animate"), lambda _: done)
    both = Worker(name="w", numeric_class="this", works={HUMAN_PLAN: lambda *_: None, ANIMATE: lambda *_: None})
    assert claim_any(bus, both) is ClaimStatus.DONE
    assert pull(bus, both, leave=lambda: False)
    assert not pull(bus, both, leave=lambda: True)


def test_silence_is_counted_anew_after_every_answer(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr(leases.time, "sleep", pauses.append)

    def answers() -> Iterator[ClaimReply | BusError]:
        for step_s in (40.0, 20.0):
            for _ in range(3):
                yield BusError("away")
                clock.now_s += step_s / 2
            yield LEASE
        yield BusError("away")
        clock.now_s += 60.0
        yield BusError("away")
        clock.now_s += 0.1
        yield BusError("away")

    with pytest.raises(BusError, match="away"):
        pull(_bus(answers(), []), _worker(lambda *_: StageResult()), leave=lambda: False)
    assert pauses == [0.5] * 8
    assert clock.now_s == pytest.approx(60.0 + 30.0 + 60.1)
