"""A worker's side of the lease protocol: claim, work, renew, complete."""

import contextlib
import hashlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from readygo.common.bus.interface import Bus
from readygo.common.errors import BusError, RunError
from readygo.common.messages import (
    Blob,
    BlobReply,
    BlobRequest,
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    RenewRequest,
    Stage,
    Verdict,
)

log = logging.getLogger(__name__)

IDLE_S = 0.05
"""Pause before asking again when nothing waits for the stage [s]."""
COORDINATOR_ABSENT_S = 60.0
"""A worker gives up when the coordinator has not answered for this long [s]."""


@dataclass(frozen=True, kw_only=True)
class StageResult:
    """What a stage made of an episode: bytes for the next stages, or the reason to skip it."""

    result: bytes = b""
    rejected: str = ""


Work = Callable[[ClaimReply, tuple[bytes, ...]], StageResult | None]
"""Turns a lease and the earlier stages' results into this stage's; None if it has been handed over elsewhere."""


def fetch_blob(bus: Bus, sha256: str) -> bytes:
    """All bytes of a blob.

    Raises:
        RunError: If nobody has it, or what came does not match its hash.
    """
    data = bytearray()
    while True:
        reply = bus.request("blob", BlobRequest(sha256=sha256, offset=len(data)), BlobReply, timeout_s=20.0)
        if reply.size < 0:
            raise RunError(f"Blob {sha256} is not known to the run.")
        data += reply.data
        if len(data) >= reply.size or not reply.data:
            break
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RunError(f"Blob {sha256} arrived damaged.")
    return bytes(data)


def claim_once(bus: Bus, stage: Stage, worker: str, numeric_class: str, work: Work) -> str:
    """Claim one episode, work on it and complete it.

    Returns:
        "lease" after work, else the coordinator's answer "wait" or "done".

    Raises:
        RunError: If the coordinator refuses this worker's numeric class.
    """
    request = ClaimRequest(worker=worker, numeric_class=numeric_class)
    claim = bus.request(f"coord/{stage.value}/claim", request, ClaimReply)
    if claim.status == "refused":
        raise RunError(
            f"The run's samples are of another numeric class than this worker's ({numeric_class}); install the "
            "versions that the run began with (`readygo inspect` names them), or record into a new folder."
        )
    if claim.status == "lease":
        _work_on(bus, stage, worker, claim, work)
    return claim.status


def pull(bus: Bus, stage: Stage, worker: str, numeric_class: str, work: Work, *, stop: threading.Event) -> None:
    """Work on episodes of `stage` until the run is over or `stop` is set; leases are renewed meanwhile.

    Raises:
        BusError: If the coordinator stays away.
        RunError: If the coordinator refuses this worker.
    """
    silent_since_s: float | None = None

    def kept(claim: ClaimReply, inputs: tuple[bytes, ...]) -> StageResult | None:
        with _renewed(bus, stage, worker, claim):
            return work(claim, inputs)

    while not stop.is_set():
        try:
            status = claim_once(bus, stage, worker, numeric_class, kept)
        except BusError as error:
            # Work may take longer than the coordinator may be absent: its time does not count.
            silent_since_s = time.monotonic() if silent_since_s is None else silent_since_s
            if time.monotonic() - silent_since_s > COORDINATOR_ABSENT_S:
                raise
            log.warning("%s; trying again", error)
            stop.wait(0.5)
            continue
        silent_since_s = None
        if status == "done":
            return
        if status == "wait":
            stop.wait(IDLE_S)


def _work_on(bus: Bus, stage: Stage, worker: str, claim: ClaimReply, work: Work) -> None:
    assert claim.episode is not None
    begin_s = time.thread_time()
    failed = ""
    outcome: StageResult | None = None
    try:
        outcome = work(claim, tuple(blob.data or _fetch(bus, blob) for blob in claim.inputs))
    except BusError:
        raise
    except Exception as error:
        log.exception("stage %s of %s failed", stage.value, claim.episode.episode_id)
        failed = f"{type(error).__name__}: {error}"
    request = CompleteRequest(
        worker=worker,
        index=claim.episode.index,
        attempt=claim.attempt,
        result=outcome.result if outcome else b"",
        rejected=outcome.rejected if outcome else "",
        failed=failed,
        cpu_s=time.thread_time() - begin_s,
    )
    verdict = bus.request(f"coord/{stage.value}/complete", request, Verdict)
    if verdict.status != "ok":
        log.warning("%s: result of attempt %d is %s", claim.episode.episode_id, claim.attempt, verdict.status)


def _fetch(bus: Bus, blob: Blob) -> bytes:
    return fetch_blob(bus, blob.sha256)


@contextlib.contextmanager
def _renewed(bus: Bus, stage: Stage, worker: str, claim: ClaimReply) -> Iterator[None]:
    """Renew a lease every third of its time for as long as the block runs."""
    assert claim.episode is not None
    request = RenewRequest(worker=worker, index=claim.episode.index, attempt=claim.attempt)
    over = threading.Event()

    def renew() -> None:
        while not over.wait(claim.ttl_s / 3):
            try:
                bus.request(f"coord/{stage.value}/renew", request, Verdict)
            except BusError as error:
                log.warning("%s", error)

    thread = threading.Thread(target=renew, name="renew", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
