"""A worker's side of the lease protocol: claim, work, renew, complete."""

import contextlib
import dataclasses
import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from readygo.common.bus import Bus
from readygo.common.errors import BusError, PeerError, RunError, reason
from readygo.common.fleet.at_work import working
from readygo.common.fleet.blobs import fetch_blob
from readygo.common.fleet.repeat import repeating
from readygo.common.fleet.shown import show_work
from readygo.common.messages import (
    ClaimReply,
    ClaimRequest,
    ClaimStatus,
    CompleteRequest,
    RenewRequest,
    Stage,
    VerdictStatus,
    topics,
)

log = logging.getLogger(__name__)

IDLE_S = 1.0
"""Pause before asking again when nothing waits for the stage, unless the coordinator says that something may [s]."""
COORDINATOR_ABSENT_S = 60.0
"""A worker gives up when the coordinator has not answered for this long [s]."""
_RETRY_S = 0.5


@dataclass(frozen=True, kw_only=True)
class StageResult:
    """What a stage made of an episode: bytes for the later stages, and the reason if it rejects the episode."""

    result: bytes = b""
    rejected: str = ""


Inputs = Mapping[str, bytes]
"""Results of the earlier stages that a stage needs, by their names."""
Work = Callable[[ClaimReply, Inputs], StageResult | None]
"""Turns a lease and the inputs into this stage's result; None if that has been handed over elsewhere."""


@dataclass(frozen=True, kw_only=True)
class Worker:
    """A worker that asks for work: its name, its stages and its presence on the bus."""

    name: str
    numeric_class: str
    works: Mapping[Stage, Work]
    """Function that does a stage's work, by stage, in the order in which the worker asks for them."""
    role: str = ""
    """Role under which the worker is announced on the bus; empty if it is not."""
    session: str = ""
    """Session that `Bus.announce` returned: the worker's leases end with it."""


def claim_any(bus: Bus, worker: Worker) -> ClaimStatus:
    """Claim an episode for the first stage that has one, work on it and complete it.

    Returns:
        LEASE after work, WAIT if nothing waits for any of the stages, DONE if the run is over.

    Raises:
        RunError: If the coordinator refuses the worker's numeric class.
    """
    for stage, work in worker.works.items():
        request = ClaimRequest(
            worker=worker.name, numeric_class=worker.numeric_class, role=worker.role, session=worker.session
        )
        claim = bus.request(topics.claim(stage.name), request)
        if claim.status is ClaimStatus.REFUSED:
            raise RunError(
                "The run's samples are of another numeric class than this worker's "
                f"({worker.numeric_class}); install the versions that the run began with (`readygo inspect` names "
                "them), or record into a new folder."
            )
        if claim.status is ClaimStatus.LEASE:
            assert claim.episode is not None
            with working(stage=stage.name, episode=claim.episode.episode_id, attempt=claim.attempt):
                _work_on(bus, stage, worker.name, claim, work)
        if claim.status is not ClaimStatus.WAIT:
            return claim.status
    return ClaimStatus.WAIT


def pull(bus: Bus, worker: Worker, *, leave: Callable[[], bool]) -> bool:
    """Work on episodes until the run is over, or `leave` says so between two of them; leases are renewed meanwhile.

    Returns:
        True if the run is over.

    Raises:
        BusError: If the coordinator stays away.
        RunError: If the coordinator refuses this worker.
    """
    works = {stage: _renewing(bus, stage, worker.name, work) for stage, work in worker.works.items()}
    worker = dataclasses.replace(worker, works=works)
    silent_since_s: float | None = None
    wake = threading.Event()
    names = {stage.name for stage in works}
    bus.subscribe(topics.WAKE, lambda woken: wake.set() if not woken.stages or names & {*woken.stages} else None)
    while not leave():
        # Before the claim: what comes while it is answered is not missed.
        wake.clear()
        try:
            status = claim_any(bus, worker)
        except BusError as error:
            # Work may take longer than the coordinator may be absent: its time does not count.
            silent_since_s = time.monotonic() if silent_since_s is None else silent_since_s
            if time.monotonic() - silent_since_s > COORDINATOR_ABSENT_S:
                raise
            log.warning("%s; trying again", error)
            time.sleep(_RETRY_S)
            continue
        silent_since_s = None
        if status is ClaimStatus.DONE:
            return True
        if status is ClaimStatus.WAIT:
            wake.wait(IDLE_S)
    return False


def _work_on(bus: Bus, stage: Stage, worker: str, claim: ClaimReply, work: Work) -> None:
    assert claim.episode is not None
    begin_s = time.thread_time()
    show_work(bus, stage, claim, begins=True)
    failed = ""
    outcome: StageResult | None = None
    try:
        outcome = work(claim, _inputs(bus, stage, claim))
    except Exception as error:
        if isinstance(error, BusError) and not isinstance(error, PeerError):
            # No participant answers: that says nothing of the episode.
            raise
        log.exception("stage %s of %s failed", stage.name, claim.episode.episode_id)
        failed = reason(error)
    request = CompleteRequest(
        worker=worker,
        index=claim.episode.index,
        attempt=claim.attempt,
        result=outcome.result if outcome else b"",
        rejected=outcome.rejected if outcome else "",
        failed=failed,
        cpu_s=time.thread_time() - begin_s,
        lease=claim.lease,
    )
    show_work(bus, stage, claim, begins=False, rejected=request.rejected, failed=failed)
    verdict = bus.request(topics.complete(stage.name), request)
    if verdict.status is not VerdictStatus.OK:
        words = f"{verdict.status.value} {verdict.reason}".strip()
        log.warning("%s: result of attempt %d is %s", claim.episode.episode_id, claim.attempt, words)


def _inputs(bus: Bus, stage: Stage, claim: ClaimReply) -> Inputs:
    results = (blob.data or fetch_blob(bus, blob.sha256) for blob in claim.inputs)
    return dict(zip(stage.needs, results, strict=True))


def _renewing(bus: Bus, stage: Stage, worker: str, work: Work) -> Work:
    def renewing(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
        with _keep_renewing(bus, stage, worker, claim):
            return work(claim, inputs)

    return renewing


@contextlib.contextmanager
def _keep_renewing(bus: Bus, stage: Stage, worker: str, claim: ClaimReply) -> Iterator[None]:
    """Renew a lease every third of its time for as long as the block runs."""
    assert claim.episode is not None
    request = RenewRequest(worker=worker, index=claim.episode.index, attempt=claim.attempt, lease=claim.lease)

    def renew() -> None:
        try:
            bus.request(topics.renew(stage.name), request)
        except BusError as error:
            log.warning("%s", error)

    with repeating(renew, every_s=claim.ttl_s / 3, name="renew"):
        yield
