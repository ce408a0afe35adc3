"""Requests about the run as a whole -> replies: what it is, how far it is, its blobs, its policies."""

import time

from readygo.common.errors import RunError
from readygo.common.messages import (
    BlobReply,
    BlobRequest,
    Command,
    ControlRequest,
    FileRef,
    OfferReply,
    OfferRequest,
    PolicyRef,
    RunSpec,
    RunSpecRequest,
    StatusReply,
    StatusRequest,
    Verdict,
    VerdictStatus,
)
from readygo.common.messages.fleet import FleetReply, FleetRequest
from readygo.services.coordinator.coordinator import Coordinator

BLOB_CHUNK_BYTES = 1_000_000
"""Largest part of a blob in one reply."""
CANCELLED = "The run was cancelled; run the same command again to resume."


def handle_spec(coordinator: Coordinator, request: RunSpecRequest) -> RunSpec:
    """Answer with the run's specification."""
    return coordinator.spec


def handle_blob(coordinator: Coordinator, request: BlobRequest) -> BlobReply:
    """One chunk of a blob."""
    size, data = coordinator.blobs.read(request.sha256, request.offset, BLOB_CHUNK_BYTES)
    return BlobReply(size=size, data=data)


def handle_offer(coordinator: Coordinator, request: OfferRequest) -> OfferReply:
    """Keep a policy for the episodes that are leased from now on; older ones that drove nothing go.

    Raises:
        RunError: If the run takes none.
        ReadygoError: If the policy cannot drive in it.
    """
    own = coordinator.spec.policy
    if own is None or own.files:
        driver = "the policy that it began with" if own else "the expert"
        raise RunError(f"Run {coordinator.spec.run} takes no policies: {driver} drives in it.")
    coordinator.check_policy(request.files)
    files = tuple(
        FileRef(path=file.name, sha256=coordinator.blobs.put(file.data), size=len(file.data)) for file in request.files
    )
    offered = coordinator.ledger.policies.offer(PolicyRef(path="", files=files, mix=own.mix), time.time_ns())
    for sha256 in coordinator.ledger.policies.idle_files():
        coordinator.blobs.drop(sha256)
    return OfferReply(version=offered.version, sha256=offered.sha256)


def handle_control(coordinator: Coordinator, request: ControlRequest) -> Verdict:
    """Pause, resume or cancel the run."""
    coordinator.paused = request.command is Command.PAUSE
    coordinator.ledger.notes.put("paused", "yes" if coordinator.paused else "no")
    coordinator.cancelled = coordinator.cancelled or request.command is Command.CANCEL
    return Verdict(status=VerdictStatus.OK)


def handle_status(coordinator: Coordinator, request: StatusRequest) -> StatusReply:
    """Answer with the run's progress."""
    ledger = coordinator.ledger
    committed, samples = ledger.census.committed_counts()
    counters = ledger.notes.counters()
    prefix = "cpu_s/"
    return StatusReply(
        wanted=coordinator.wanted,
        committed=committed,
        samples=samples,
        waiting=ledger.census.waiting(),
        leased=ledger.census.leased_by_stage(),
        rejected=ledger.census.rejections(),
        requeued=int(counters.get("requeued", 0)),
        cpu_s={name.removeprefix(prefix): value for name, value in counters.items() if name.startswith(prefix)},
        finished=coordinator.finished,
        failed=coordinator.failed or (CANCELLED if coordinator.cancelled and not coordinator.finished else ""),
        kept=ledger.census.continued_by_reason(),
        policies=len(ledger.policies.all()),
        trouble=" ".join(coordinator.troubles.values()),
        paused=coordinator.paused,
        run=coordinator.spec.run,
        priority=coordinator.config.priority,
    )


def handle_fleet(coordinator: Coordinator, request: FleetRequest | None = None) -> FleetReply:
    """Answer with the processes that work on the run."""
    return FleetReply(
        stages=tuple(stage.name for stage in coordinator.spec.stages),
        workers=coordinator.roster.workers(coordinator.ledger.census.leases()),
        done_per_minute=coordinator.roster.done_per_minute(),
    )
