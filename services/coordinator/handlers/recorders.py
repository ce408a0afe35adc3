"""Requests of recorders -> replies: which samples may come, and which episodes are durable."""

import logging

from readygo.common.errors import RunError
from readygo.common.messages import (
    DoneRequest,
    ExpectRequest,
    GrantRequest,
    LostRequest,
    PendingReply,
    PendingRequest,
    TroubleRequest,
    Verdict,
    VerdictStatus,
)
from readygo.services.coordinator.coordinator import REASON_MAX, Coordinator
from readygo.services.coordinator.proofs import not_the_holder
from readygo.services.coordinator.protocol import Written

log = logging.getLogger(__name__)


def handle_expect(coordinator: Coordinator, request: ExpectRequest) -> Verdict:
    """Are samples of this attempt due at this recorder?"""
    key, spec = request.episode, coordinator.spec
    if (key.seed, key.split) != (spec.seed, spec.split):
        reason = f"the run has {spec.split.value} episodes of seed {spec.seed}, not {key.episode_id}"
        return Verdict(status=VerdictStatus.STALE, reason=reason)
    if wrong := _of_another_recorder(coordinator, request.recorder, key.index):
        return wrong
    status = coordinator.ledger.append_verdict(key.index, request.attempt)
    if status is VerdictStatus.OK and not coordinator.proofs.proves(request.lease, key.index, request.attempt):
        return not_the_holder(key.index, request.attempt)
    late = status is VerdictStatus.STALE
    reason = f"attempt {request.attempt} of {key.episode_id} is not leased to be recorded" if late else ""
    return Verdict(status=status, reason=reason)


def handle_grant(coordinator: Coordinator, request: GrantRequest) -> Verdict:
    """May the recorder make this attempt durable?"""
    if wrong := _of_another_recorder(coordinator, request.recorder, request.index):
        return wrong
    return Verdict(status=coordinator.ledger.grant(request.index, request.attempt, request.recorder))


def handle_done(coordinator: Coordinator, request: DoneRequest) -> Verdict:
    """An episode is durable; STALE if it was not granted to the recorder under this attempt.

    Raises:
        RunError: If it is not where the recorder says.
    """
    if unknown := _unknown_recorder(coordinator, request.recorder):
        return unknown
    if not coordinator.holds(request):
        raise RunError(f"Episode {request.index} is not in {request.shard} of recorder {request.recorder}.")
    written = Written(
        recorder=request.recorder,
        attempt=request.attempt,
        shard=request.shard,
        samples=request.sample_count,
        policy=request.policy,
    )
    hashes = coordinator.ledger.commit(request.index, written)
    if hashes is None:
        reason = f"attempt {request.attempt} of episode {request.index} is not granted to {request.recorder}"
        log.warning("done refused: %s", reason)
        return Verdict(status=VerdictStatus.STALE, reason=reason)
    for sha256 in hashes:
        coordinator.blobs.drop(sha256)
    return Verdict(status=VerdictStatus.OK)


def handle_lost(coordinator: Coordinator, request: LostRequest) -> Verdict:
    """A granted episode did not become durable."""
    held = coordinator.ledger.take_back(request.index, request.recorder, request.attempt)
    if held and request.reason:
        coordinator.failed = request.reason[:REASON_MAX]
    return Verdict(status=VerdictStatus.OK)


def handle_trouble(coordinator: Coordinator, request: TroubleRequest) -> Verdict:
    """Something keeps a recorder from recording, or does no more; DONE if others record now what it has not."""
    if unknown := _unknown_recorder(coordinator, request.recorder):
        return unknown
    coordinator.note_trouble(request.recorder, request.reason[:REASON_MAX])
    taken = bool(request.reason) and coordinator.others_take_over(request.recorder)
    return Verdict(status=VerdictStatus.DONE if taken else VerdictStatus.OK)


def handle_pending(coordinator: Coordinator, request: PendingRequest) -> PendingReply:
    """Which grants does the recorder hold?"""
    granted = coordinator.ledger.census.granted_attempts(request.recorder)
    return PendingReply(indices=tuple(granted), attempts=tuple(granted.values()))


def _of_another_recorder(coordinator: Coordinator, recorder: str, index: int) -> Verdict | None:
    """Verdict for a recorder to which an episode does not belong; None for the right one."""
    chosen = coordinator.ledger.census.recorder_of(index)
    if unknown := _unknown_recorder(coordinator, recorder):
        return unknown
    if chosen in ("", recorder):
        return None
    return Verdict(status=VerdictStatus.STALE, reason=f"episode {index} is for {chosen}, not {recorder}")


def _unknown_recorder(coordinator: Coordinator, recorder: str) -> Verdict | None:
    """Verdict for a recorder that is not one of the run's recorders, or no longer; None for the others."""
    if recorder in coordinator.recorders:
        return None
    return Verdict(status=VerdictStatus.STALE, reason=f"the run has no recorder {recorder!r}")
