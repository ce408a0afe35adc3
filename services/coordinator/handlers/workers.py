"""Requests of workers -> replies: the leases of stages, and what comes of them."""

import hashlib
import logging

from readygo.common.errors import DiskError
from readygo.common.messages import (
    Blob,
    ClaimReply,
    ClaimRequest,
    ClaimStatus,
    CompleteRequest,
    EpisodeKey,
    OnRejection,
    PolicyRef,
    RenewRequest,
    Stage,
    Verdict,
    VerdictStatus,
)
from readygo.services.coordinator.coordinator import LEDGER, REASON_MAX, Coordinator
from readygo.services.coordinator.giving_up import after_rejection, set_aside
from readygo.services.coordinator.ledger import Lease
from readygo.services.coordinator.proofs import not_the_holder
from readygo.services.coordinator.protocol import Holder

log = logging.getLogger(__name__)

FAILURES_MAX = 3
"""Workers' errors on one episode before it is set aside."""
INLINE_BYTES = 16_000
"""Results up to this size travel in the claim's reply; larger ones are fetched as blobs."""
AHEAD_PER_PROCESS = 2
"""Episodes that may be between planning and the shards for each process that is there, at least."""
_RESULTS = "results"
"""Key of `Coordinator.troubles` for a disk that does not take the results of stages."""


def handle_claim(coordinator: Coordinator, stage: Stage, request: ClaimRequest) -> ClaimReply:
    """Lease the next episode that waits for `stage`."""
    if coordinator.over:
        return ClaimReply(status=ClaimStatus.DONE)
    if not _same_numeric_class(coordinator, request.numeric_class):
        return ClaimReply(status=ClaimStatus.REFUSED)
    if coordinator.paused or (stage == coordinator.spec.stages[0] and _planned_ahead(coordinator)):
        return ClaimReply(status=ClaimStatus.WAIT)
    deadline_s = coordinator.clock() + coordinator.config.lease_s
    holder = Holder(worker=request.worker, role=request.role, session=request.session)
    try:
        recorder = coordinator.choose_recorder() if stage.records else ""
        while lease := coordinator.ledger.claim(stage, holder, deadline_s, recorder):
            if (inputs := _inputs(coordinator, lease)) is not None:
                coordinator.given[recorder] += 1
                return _lease_reply(coordinator, recorder, lease, inputs)
            coordinator.ledger.restart(lease.index)
    except DiskError as error:
        coordinator.note_trouble(LEDGER, str(error))
    return ClaimReply(status=ClaimStatus.WAIT)


def handle_renew(coordinator: Coordinator, request: RenewRequest) -> Verdict:
    """Prolong a lease."""
    if other := _held_by_another(coordinator, request):
        return other
    deadline_s = coordinator.clock() + coordinator.config.lease_s
    return _verdict(coordinator.ledger.renew(request.index, request.attempt, deadline_s))


def handle_complete(coordinator: Coordinator, stage: Stage, request: CompleteRequest) -> Verdict:
    """Take a stage's result, a rejection or a failure."""
    with coordinator.ledger.together():
        return _advance_stage(coordinator, stage, request)


def _advance_stage(coordinator: Coordinator, stage: Stage, request: CompleteRequest) -> Verdict:
    ledger = coordinator.ledger
    if other := _held_by_another(coordinator, request):
        return other
    if not ledger.completes(stage, request.index, request.attempt):
        return Verdict(status=VerdictStatus.STALE)
    ledger.notes.add(f"cpu_s/{stage.name}", request.cpu_s)
    rejected = request.rejected[:REASON_MAX]
    if request.failed:
        failures = ledger.fail(stage, request.index, request.attempt)
        if failures is not None and failures >= FAILURES_MAX:
            set_aside(coordinator, request.index, f"stage {stage.name} failed: {request.failed[:REASON_MAX]}")
        return _verdict(failures is not None)
    if rejected and stage.on_rejection is OnRejection.SKIP:
        held = ledger.reject(stage, request.index, request.attempt, rejected)
        if held:
            after_rejection(coordinator)
        return _verdict(held)
    if stage.records:
        # The recorder's commit completes the stage; its worker only says what the work cost.
        return Verdict(status=VerdictStatus.OK)
    sha256 = _store_result(coordinator, request.result)
    return _verdict(ledger.advance(stage, request.index, request.attempt, sha256, reason=rejected))


def _store_result(coordinator: Coordinator, result: bytes) -> str:
    """Keep a result, under its hash; a disk that does not take it is told: its stage would be done in vain for ever.

    Raises:
        DiskError: If the disk does not take it.
    """
    try:
        sha256 = coordinator.blobs.put(result)
    except DiskError as error:
        coordinator.note_trouble(_RESULTS, str(error))
        raise
    coordinator.note_trouble(_RESULTS, "")
    return sha256


def _held_by_another(coordinator: Coordinator, request: RenewRequest | CompleteRequest) -> Verdict | None:
    """Verdict for a worker that does not hold the lease that its request names; None for the holder."""
    if not coordinator.proofs.proves(request.lease, request.index, request.attempt):
        return not_the_holder(request.index, request.attempt)
    holder = coordinator.ledger.holder(request.index, request.attempt)
    return None if holder.worker in ("", request.worker) else not_the_holder(request.index, request.attempt)


def _verdict(held: bool) -> Verdict:
    return Verdict(status=VerdictStatus.OK if held else VerdictStatus.STALE)


def _same_numeric_class(coordinator: Coordinator, numeric_class: str) -> bool:
    if numeric_class and not coordinator.numeric_class:
        coordinator.numeric_class = coordinator.ledger.notes.agree("numeric_class", numeric_class)
    return bool(numeric_class) and coordinator.numeric_class == numeric_class


def _planned_ahead(coordinator: Coordinator) -> bool:
    ahead = max(coordinator.config.plan_ahead, AHEAD_PER_PROCESS * coordinator.roster.size)
    return coordinator.ledger.census.begun_count() >= ahead


def _inputs(coordinator: Coordinator, lease: Lease) -> tuple[Blob, ...] | None:
    """What a stage needs, None if some of it is lost or damaged; what is fetched later is checked by who fetches."""
    inputs = []
    for sha256 in lease.inputs:
        size, data = coordinator.blobs.read(sha256, 0, INLINE_BYTES)
        inline = 0 <= size <= INLINE_BYTES
        if size < 0 or (inline and hashlib.sha256(data).hexdigest() != sha256):
            log.warning("result %s of episode %d is lost or damaged: the episode starts again", sha256, lease.index)
            return None
        inputs.append(Blob(sha256=sha256, data=data if inline else b""))
    return tuple(inputs)


def _lease_reply(coordinator: Coordinator, recorder: str, lease: Lease, inputs: tuple[Blob, ...]) -> ClaimReply:
    return ClaimReply(
        status=ClaimStatus.LEASE,
        episode=EpisodeKey(seed=coordinator.spec.seed, split=coordinator.spec.split, index=lease.index),
        attempt=lease.attempt,
        ttl_s=coordinator.config.lease_s,
        inputs=inputs,
        recorder=recorder,
        policy=_leased_policy(coordinator, lease),
        lease=coordinator.proofs.of(lease.index, lease.attempt),
    )


def _leased_policy(coordinator: Coordinator, lease: Lease) -> PolicyRef | None:
    own = coordinator.spec.policy
    if own is None or not lease.policy:
        return None
    (offered,) = (policy for policy in coordinator.ledger.policies.all() if policy.sha256 == lease.policy)
    return PolicyRef(path="", files=offered.files, mix=own.mix)
