"""Requests to the coordinator -> replies; the ledger holds all state that must survive."""

import time
from collections.abc import Callable, Sequence

from readygo.common.errors import ReadygoError, RunError
from readygo.common.messages import (
    Blob,
    BlobReply,
    BlobRequest,
    ClaimReply,
    ClaimRequest,
    ClaimStatus,
    Command,
    CompleteRequest,
    ControlRequest,
    DoneRequest,
    EpisodeKey,
    FileRef,
    GrantRequest,
    LostRequest,
    OfferReply,
    OfferRequest,
    OnRejection,
    PendingReply,
    PendingRequest,
    PolicyFile,
    PolicyRef,
    RenewRequest,
    RunSpec,
    RunSpecRequest,
    Stage,
    StatusReply,
    StatusRequest,
    Verdict,
    VerdictStatus,
)
from readygo.services.coordinator.blobs import BlobStore
from readygo.services.coordinator.config import CoordinatorConfig
from readygo.services.coordinator.ledger import Lease, Ledger

CANCELLED = "The run was cancelled; run the same command again to go on."


class Coordinator:
    """One run: what is wanted, what is done, and who may do the rest."""

    def __init__(
        self,
        *,
        spec: RunSpec,
        wanted: int,
        ledger: Ledger,
        blobs: BlobStore,
        config: CoordinatorConfig | None = None,
        check_policy: Callable[[Sequence[PolicyFile]], None] = lambda files: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Go on with a run where its ledger is; nobody holds a lease then.

        Args:
            spec: What the run is.
            wanted: Episodes that it shall have.
            ledger: How far it is.
            blobs: Results between the stages, and offered policies.
            config: Settings.
            check_policy: Raises ReadygoError at the files of a policy that cannot drive in the run.
            clock: Time that leases are measured by [s].

        Raises:
            RunError: If a recorder that holds grants is not among the run's recorders any more.
        """
        self.spec = spec
        self.wanted = wanted
        self.ledger = ledger
        self.blobs = blobs
        self.config = config or CoordinatorConfig()
        self.check_policy = check_policy
        self.clock = clock
        self.failed = ""
        self.paused = False
        self.cancelled = False
        self._check_recorders()
        ledger.requeue_all()
        ledger.drop_episodes(wanted)
        blobs.keep_only(ledger.results() | {file.sha256 for policy in ledger.policies() for file in policy.files})
        ledger.open_episodes(wanted)

    @property
    def finished(self) -> bool:
        """True when all wanted episodes are durable."""
        return self.ledger.committed()[0] >= self.wanted

    @property
    def over(self) -> bool:
        """True when no more work will be given out."""
        return bool(self.failed) or self.cancelled or self.finished

    def _check_recorders(self) -> None:
        """Refuse to leave out a recorder that may hold episodes which the ledger has not heard of."""
        if missing := sorted(self.ledger.granted_recorders() - set(self.config.recorders)):
            raise RunError(
                f"Recorder {missing[0]!r} was given episodes of this run; name it in [coordinator] recorders again."
            )


def handle_spec(coordinator: Coordinator, request: RunSpecRequest) -> RunSpec:
    """What the run is."""
    return coordinator.spec


def handle_claim(coordinator: Coordinator, stage: Stage, request: ClaimRequest) -> ClaimReply:
    """Lease the next episode that waits for `stage`."""
    if coordinator.over:
        return ClaimReply(status=ClaimStatus.DONE)
    if not _same_numeric_class(coordinator, request.numeric_class):
        return ClaimReply(status=ClaimStatus.REFUSED)
    if coordinator.paused or (stage == coordinator.spec.stages[0] and _planned_ahead(coordinator)):
        return ClaimReply(status=ClaimStatus.WAIT)
    lease = coordinator.ledger.claim(stage, request.worker, coordinator.clock() + coordinator.config.lease_s)
    return ClaimReply(status=ClaimStatus.WAIT) if lease is None else _lease_reply(coordinator, stage, lease)


def handle_renew(coordinator: Coordinator, request: RenewRequest) -> Verdict:
    """Prolong a lease."""
    deadline_s = coordinator.clock() + coordinator.config.lease_s
    return _verdict(coordinator.ledger.renew(request.index, request.attempt, deadline_s))


def handle_complete(coordinator: Coordinator, stage: Stage, request: CompleteRequest) -> Verdict:
    """Take a stage's result, a rejection or a failure."""
    ledger = coordinator.ledger
    ledger.add(f"cpu_s/{stage.name}", request.cpu_s)
    if request.failed:
        failures = ledger.fail(stage, request.index, request.attempt)
        if failures is not None and failures >= coordinator.config.failures_max:
            coordinator.failed = f"Stage {stage.name} of episode {request.index} failed: {request.failed}"
        return _verdict(failures is not None)
    if request.rejected and stage.on_rejection is OnRejection.SKIP:
        held = ledger.reject(stage, request.index, request.attempt, request.rejected)
        if held:
            _after_rejection(coordinator)
        return _verdict(held)
    if stage.records:
        # The recorder's commit completes the stage; its worker only says what the work cost.
        return Verdict(status=VerdictStatus.OK)
    sha256 = coordinator.blobs.put(request.result)
    return _verdict(ledger.advance(stage, request.index, request.attempt, sha256, reason=request.rejected))


def handle_grant(coordinator: Coordinator, request: GrantRequest) -> Verdict:
    """May the recorder make this attempt durable?"""
    return Verdict(status=coordinator.ledger.grant(request.index, request.attempt, request.recorder))


def handle_done(coordinator: Coordinator, request: DoneRequest) -> Verdict:
    """An episode is durable; STALE if it is in another recorder's shard already."""
    hashes = coordinator.ledger.commit(
        request.index, request.recorder, request.shard, request.sample_count, request.policy
    )
    for sha256 in hashes or ():
        coordinator.blobs.drop(sha256)
    return _verdict(hashes is not None)


def handle_lost(coordinator: Coordinator, request: LostRequest) -> Verdict:
    """A granted episode did not become durable."""
    coordinator.ledger.take_back(request.index, request.recorder)
    if request.reason:
        coordinator.failed = request.reason
    return Verdict(status=VerdictStatus.OK)


def handle_pending(coordinator: Coordinator, request: PendingRequest) -> PendingReply:
    """Which grants does the recorder hold?"""
    return PendingReply(indices=coordinator.ledger.granted(request.recorder))


def handle_blob(coordinator: Coordinator, request: BlobRequest) -> BlobReply:
    """One chunk of a blob."""
    size, data = coordinator.blobs.read(request.sha256, request.offset, coordinator.config.blob_chunk_bytes)
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
    offered = coordinator.ledger.offer(PolicyRef(path="", files=files, mix=own.mix), time.time_ns())
    for sha256 in coordinator.ledger.idle_policy_files():
        coordinator.blobs.drop(sha256)
    return OfferReply(version=offered.version, sha256=offered.sha256)


def handle_control(coordinator: Coordinator, request: ControlRequest) -> Verdict:
    """Pause, resume or cancel the run."""
    coordinator.paused = request.command is Command.PAUSE
    coordinator.cancelled = coordinator.cancelled or request.command is Command.CANCEL
    return Verdict(status=VerdictStatus.OK)


def handle_status(coordinator: Coordinator, request: StatusRequest) -> StatusReply:
    """How far the run is."""
    ledger = coordinator.ledger
    committed, samples = ledger.committed()
    counters = ledger.counters()
    prefix = "cpu_s/"
    return StatusReply(
        wanted=coordinator.wanted,
        committed=committed,
        samples=samples,
        waiting=ledger.waiting(),
        leased=ledger.leased(),
        rejected=ledger.rejections(),
        requeued=int(counters.get("requeued", 0)),
        cpu_s={name.removeprefix(prefix): value for name, value in counters.items() if name.startswith(prefix)},
        finished=coordinator.finished,
        failed=coordinator.failed or (CANCELLED if coordinator.cancelled and not coordinator.finished else ""),
        kept=ledger.kept(),
        policies=len(ledger.policies()),
    )


def requeue_lost(coordinator: Coordinator, *, worker: str | None = None) -> None:
    """End the leases that ran out, or those of a worker that is gone."""
    ledger = coordinator.ledger
    ended = ledger.requeue_expired(coordinator.clock()) if worker is None else ledger.requeue_worker(worker)
    if ended:
        ledger.add("requeued", ended)


def _verdict(held: bool) -> Verdict:
    return Verdict(status=VerdictStatus.OK if held else VerdictStatus.STALE)


def _same_numeric_class(coordinator: Coordinator, numeric_class: str) -> bool:
    return not numeric_class or coordinator.ledger.agree("numeric_class", numeric_class) == numeric_class


def _planned_ahead(coordinator: Coordinator) -> bool:
    return coordinator.ledger.begun() >= coordinator.config.plan_ahead


def _lease_reply(coordinator: Coordinator, stage: Stage, lease: Lease) -> ClaimReply:
    recorders = coordinator.config.recorders
    inputs = []
    for sha256 in lease.inputs:
        data = coordinator.blobs.get(sha256)
        if data is None:
            raise ReadygoError(f"Result {sha256} of episode {lease.index} is gone from the run's folder.")
        inputs.append(Blob(sha256=sha256, data=data if len(data) <= coordinator.config.inline_bytes else b""))
    return ClaimReply(
        status=ClaimStatus.LEASE,
        episode=EpisodeKey(seed=coordinator.spec.seed, split=coordinator.spec.split, index=lease.index),
        attempt=lease.attempt,
        ttl_s=coordinator.config.lease_s,
        inputs=tuple(inputs),
        recorder=recorders[lease.index % len(recorders)] if stage.records else "",
        policy=_leased_policy(coordinator, lease),
    )


def _leased_policy(coordinator: Coordinator, lease: Lease) -> PolicyRef | None:
    own = coordinator.spec.policy
    if own is None or not lease.policy:
        return None
    (offered,) = (policy for policy in coordinator.ledger.policies() if policy.sha256 == lease.policy)
    return PolicyRef(path="", files=offered.files, mix=own.mix)


def _after_rejection(coordinator: Coordinator) -> None:
    rejected = sum(coordinator.ledger.rejections().values())
    accepted = coordinator.ledger.committed()[0] + coordinator.ledger.waiting_at(coordinator.spec.stages[-1])
    if rejected >= coordinator.config.rejections_max and rejected > 20 * accepted:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in coordinator.ledger.rejections().items())
        coordinator.failed = f"{rejected} indices were rejected and {accepted} accepted: {reasons}."
        return
    coordinator.ledger.open_episodes(coordinator.wanted)
