"""Requests to the coordinator -> replies; the ledger holds all state that must survive."""

import hashlib
import hmac
import logging
import secrets
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from readygo.common.errors import DiskError, RunError
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
    ExpectRequest,
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
    TroubleRequest,
    Verdict,
    VerdictStatus,
)
from readygo.common.messages.fleet import FleetReply, FleetRequest
from readygo.services.coordinator.blobs import BlobStore
from readygo.services.coordinator.config import CoordinatorConfig
from readygo.services.coordinator.ledger import Lease, Ledger
from readygo.services.coordinator.roster import Roster

log = logging.getLogger(__name__)

REASON_MAX = 2000
"""Characters of a reason that are kept."""
AHEAD_PER_PROCESS = 2
"""Episodes that may be between planning and the shards for each process that is there, at least."""
_RESULTS = "results"
"""Whose trouble it is when the disk does not take what stages have made."""
_LEDGER = "ledger"
"""Whose trouble it is when the coordinator's own disk takes nothing."""
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
        holds: Callable[[DoneRequest], bool] = lambda report: True,
        set_aside: Callable[[int, str, Mapping[str, bytes]], str] = lambda index, reason, results: "",
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
            holds: Tells whether an episode is where its recorder says that it is.
            set_aside: Gets what was given up: index, reason and results by stage; answers with words on where it is.
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
        self.holds = holds
        self.set_aside = set_aside
        self.clock = clock
        self.roster = Roster(clock)
        self.numeric_class = spec.metadata.get("numeric_class", "")
        """What all of the run is made with; agreed on with the first claim."""
        self.told: object = None
        """What of note was said last of how far the run is."""
        self.told_s = 0.0
        self.secret = secrets.token_bytes(32)
        """What leases are proved by; they end with the process."""
        self.failed = ""
        self.paused = ledger.notes.get("paused") == "yes"
        self.cancelled = False
        self.troubles: dict[str, str] = {}
        """What somebody must mend before the run goes on, by whom it keeps from work."""
        self.recorders = tuple(name for name in self.config.recorders if name not in ledger.retired())
        """Those that were not given up."""
        self.given: Counter[str] = Counter()
        """Leases that each of them got since the process began."""
        self._check_recorders()
        if self.numeric_class:
            self.numeric_class = ledger.notes.agree("numeric_class", self.numeric_class)
        ledger.requeue_all()
        ledger.drop_episodes(wanted)
        blobs.keep_only(
            ledger.census.results() | {file.sha256 for policy in ledger.policies.all() for file in policy.files}
        )
        ledger.open_episodes(wanted)

    @property
    def finished(self) -> bool:
        """True when all wanted episodes are durable."""
        return self.ledger.census.committed()[0] >= self.wanted

    @property
    def over(self) -> bool:
        """True when no more work will be given out."""
        return bool(self.failed) or self.cancelled or self.finished

    def choose_recorder(self) -> str:
        """The recorder for the next episode: of those that can record, the one with the fewest on their way to it.

        Of equal ones it is the one that got the fewest so far.
        """
        loads = self.ledger.census.loads()
        return min(self._able() or self.recorders, key=lambda name: (loads.get(name, 0), self.given[name]))

    def _able(self) -> list[str]:
        """Recorders that nothing is known of that would keep them from recording."""
        return [name for name in self.recorders if not {name, _presence(name)} & set(self.troubles)]

    def others_take_over(self, recorder: str) -> bool:
        """Have other recorders record what one cannot; False if there is none that can."""
        if set(self._able()) <= {recorder}:
            return False
        if taken := self.ledger.take_from(recorder):
            log.warning("%d episodes that %s cannot record go to others", taken, recorder)
        return True

    def note_recorder(self, name: str, *, alive: bool) -> None:
        """A recorder came, or is gone: what was granted to it waits for it, and so do its senders."""
        granted = 0 if alive else len(self.ledger.census.granted(name))
        gone = (
            f"Recorder {name} is gone and holds {granted} episodes; `readygo worker recorder --name {name}` starts it."
        )
        _trouble(self, _presence(name), "" if alive else gone)

    def _check_recorders(self) -> None:
        """Refuse to leave out a recorder that may hold episodes which the ledger has not heard of."""
        if not self.recorders:
            raise RunError(
                f"All recorders of this run were given up ({', '.join(self.config.recorders)}): name another one in "
                "[coordinator] recorders."
            )
        if missing := sorted(self.ledger.census.granted_recorders() - set(self.config.recorders)):
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
    deadline_s = coordinator.clock() + coordinator.config.lease_s
    try:
        recorder = coordinator.choose_recorder() if stage.records else ""
        while lease := coordinator.ledger.claim(stage, request.worker, deadline_s, recorder):
            if (inputs := _inputs(coordinator, lease)) is not None:
                coordinator.given[recorder] += 1
                return _lease_reply(coordinator, recorder, lease, inputs)
            coordinator.ledger.begin_anew(lease.index)
    except DiskError as error:
        coordinator.troubles[_LEDGER] = str(error)
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
        return _completed(coordinator, stage, request)


def _completed(coordinator: Coordinator, stage: Stage, request: CompleteRequest) -> Verdict:
    ledger = coordinator.ledger
    if other := _held_by_another(coordinator, request):
        return other
    ledger.notes.add(f"cpu_s/{stage.name}", request.cpu_s)
    rejected = request.rejected[:REASON_MAX]
    if request.failed:
        failures = ledger.fail(stage, request.index, request.attempt)
        if failures is not None and failures >= coordinator.config.failures_max:
            _set_aside(coordinator, request.index, f"stage {stage.name} failed: {request.failed[:REASON_MAX]}")
        return _verdict(failures is not None)
    if rejected and stage.on_rejection is OnRejection.SKIP:
        held = ledger.reject(stage, request.index, request.attempt, rejected)
        if held:
            _after_rejection(coordinator)
        return _verdict(held)
    if stage.records:
        # The recorder's commit completes the stage; its worker only says what the work cost.
        return Verdict(status=VerdictStatus.OK)
    sha256 = _kept(coordinator, request.result)
    return _verdict(ledger.advance(stage, request.index, request.attempt, sha256, reason=rejected))


def _kept(coordinator: Coordinator, result: bytes) -> str:
    """Keep a result, under its hash; a disk that does not take it is told: its stage would be done in vain for ever.

    Raises:
        DiskError: If the disk does not take it.
    """
    try:
        sha256 = coordinator.blobs.put(result)
    except DiskError as error:
        _trouble(coordinator, _RESULTS, str(error))
        raise
    _trouble(coordinator, _RESULTS, "")
    return sha256


def handle_expect(coordinator: Coordinator, request: ExpectRequest) -> Verdict:
    """Are samples of this attempt due at this recorder?"""
    key, spec = request.episode, coordinator.spec
    if (key.seed, key.split) != (spec.seed, spec.split):
        reason = f"the run has {spec.split.value} episodes of seed {spec.seed}, not {key.episode_id}"
        return Verdict(status=VerdictStatus.STALE, reason=reason)
    if wrong := _of_another_recorder(coordinator, request.recorder, key.index):
        return wrong
    status = coordinator.ledger.census.expected(key.index, request.attempt)
    if status is VerdictStatus.OK and not _proves_lease(coordinator, request.lease, key.index, request.attempt):
        return _not_the_holder(key.index, request.attempt)
    late = status is VerdictStatus.STALE
    reason = f"attempt {request.attempt} of {key.episode_id} is not leased to be recorded" if late else ""
    return Verdict(status=status, reason=reason)


def handle_grant(coordinator: Coordinator, request: GrantRequest) -> Verdict:
    """May the recorder make this attempt durable?"""
    if wrong := _of_another_recorder(coordinator, request.recorder, request.index):
        return wrong
    return Verdict(status=coordinator.ledger.grant(request.index, request.attempt, request.recorder))


def handle_done(coordinator: Coordinator, request: DoneRequest) -> Verdict:
    """An episode is durable; STALE if it is in another recorder's shard already.

    Raises:
        RunError: If it is not where the recorder says.
    """
    if not coordinator.holds(request):
        raise RunError(f"Episode {request.index} is not in {request.shard} of recorder {request.recorder}.")
    hashes = coordinator.ledger.commit(
        request.index, request.recorder, request.shard, request.sample_count, request.policy
    )
    for sha256 in hashes or ():
        coordinator.blobs.drop(sha256)
    return _verdict(hashes is not None)


def handle_lost(coordinator: Coordinator, request: LostRequest) -> Verdict:
    """A granted episode did not become durable."""
    held = coordinator.ledger.take_back(request.index, request.recorder)
    if held and request.reason:
        coordinator.failed = request.reason[:REASON_MAX]
    return Verdict(status=VerdictStatus.OK)


def handle_trouble(coordinator: Coordinator, request: TroubleRequest) -> Verdict:
    """Something keeps a recorder from recording, or does no more; DONE if others record now what it has not."""
    if unknown := _unknown_recorder(coordinator, request.recorder):
        return unknown
    _trouble(coordinator, request.recorder, request.reason[:REASON_MAX])
    taken = bool(request.reason) and coordinator.others_take_over(request.recorder)
    return Verdict(status=VerdictStatus.DONE if taken else VerdictStatus.OK)


def handle_pending(coordinator: Coordinator, request: PendingRequest) -> PendingReply:
    """Which grants does the recorder hold?"""
    return PendingReply(indices=coordinator.ledger.census.granted(request.recorder))


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
    """How far the run is."""
    ledger = coordinator.ledger
    committed, samples = ledger.census.committed()
    counters = ledger.notes.counters()
    prefix = "cpu_s/"
    return StatusReply(
        wanted=coordinator.wanted,
        committed=committed,
        samples=samples,
        waiting=ledger.census.waiting(),
        leased=ledger.census.leased(),
        rejected=ledger.census.rejections(),
        requeued=int(counters.get("requeued", 0)),
        cpu_s={name.removeprefix(prefix): value for name, value in counters.items() if name.startswith(prefix)},
        finished=coordinator.finished,
        failed=coordinator.failed or (CANCELLED if coordinator.cancelled and not coordinator.finished else ""),
        kept=ledger.census.kept(),
        policies=len(ledger.policies.all()),
        trouble=" ".join(coordinator.troubles.values()),
        paused=coordinator.paused,
        run=coordinator.spec.run,
        priority=coordinator.config.priority,
    )


def handle_fleet(coordinator: Coordinator, request: FleetRequest | None = None) -> FleetReply:
    """Who works on the run."""
    return FleetReply(
        stages=tuple(stage.name for stage in coordinator.spec.stages),
        workers=coordinator.roster.workers(coordinator.ledger.census.leases()),
        done_per_minute=coordinator.roster.done_per_minute(),
    )


def note_absent(coordinator: Coordinator) -> None:
    """Tell of stages that episodes wait for, and that nobody who is there does; call it now and then."""
    for stage in coordinator.spec.stages:
        waiting = coordinator.ledger.census.waiting_at(stage)
        absent_s = coordinator.roster.absent_s(stage.name, stage.role, needed=waiting > 0)
        words = (
            f"{waiting} episodes wait for stage {stage.name}, and no {stage.role} is there; "
            f"`readygo worker {stage.role}` starts one."
        )
        _trouble(coordinator, f"absence of {stage.name}", words if absent_s > coordinator.config.absent_s else "")


def requeue_lost(coordinator: Coordinator, *, worker: str | None = None) -> bool:
    """End the leases that ran out, or those of a worker that is gone; True if there were any.

    A disk that takes nothing is no reason to end: it is told as trouble, and the leases are freed when it does again.
    """
    try:
        ended = _requeue_expired(coordinator) if worker is None else _requeue_worker(coordinator, worker)
        # Nothing but a write tells that the disk takes writes again.
        if ended or _LEDGER in coordinator.troubles:
            coordinator.ledger.notes.add("requeued", ended)
    except DiskError as error:
        _trouble(coordinator, _LEDGER, str(error))
        return False
    _trouble(coordinator, _LEDGER, "")
    return ended > 0


def _requeue_expired(coordinator: Coordinator) -> int:
    return coordinator.ledger.requeue_expired(coordinator.clock())


def _requeue_worker(coordinator: Coordinator, worker: str) -> int:
    ended = coordinator.ledger.requeue_worker(worker)
    for index, deaths in ended:
        if deaths >= coordinator.config.deaths_max:
            _set_aside(coordinator, index, f"{deaths} workers ended while they held it")
    return len(ended)


def _set_aside(coordinator: Coordinator, index: int, reason: str) -> None:
    """Give an episode up that fails again and again; a run in which most do ends with the reason."""
    results = coordinator.ledger.set_aside(index, reason)
    data = {stage: coordinator.blobs.get(sha256) or b"" for stage, sha256 in results.items()}
    where = coordinator.set_aside(index, reason, data)
    log.warning("episode %d is set aside: %s%s", index, reason, where)
    aside, committed = coordinator.ledger.census.aside(), coordinator.ledger.census.committed()[0]
    if aside >= coordinator.config.aside_max and aside > committed:
        coordinator.failed = f"{aside} episodes were set aside, the last one is {index}: {reason}{where}"
        return
    coordinator.ledger.open_episodes(coordinator.wanted)


def _trouble(coordinator: Coordinator, who: str, reason: str) -> None:
    if reason:
        coordinator.troubles[who] = reason
    else:
        coordinator.troubles.pop(who, None)


def _held_by_another(coordinator: Coordinator, request: RenewRequest | CompleteRequest) -> Verdict | None:
    """What is said to somebody who speaks for a lease that another worker holds."""
    holder = coordinator.ledger.census.holder(request.index, request.attempt)
    if not holder:
        return None
    proved = _proves_lease(coordinator, request.lease, request.index, request.attempt)
    return None if proved and holder == request.worker else _not_the_holder(request.index, request.attempt)


def _not_the_holder(index: int, attempt: int) -> Verdict:
    log.warning("attempt %d of episode %d: refused to somebody who does not hold its lease", attempt, index)
    reason = f"attempt {attempt} of episode {index} is held by another worker"
    return Verdict(status=VerdictStatus.STALE, reason=reason)


def _lease_proof(coordinator: Coordinator, index: int, attempt: int) -> str:
    """What the holder of a lease alone is told."""
    return hmac.digest(coordinator.secret, f"{index} {attempt}".encode(), "sha256").hex()


def _proves_lease(coordinator: Coordinator, proof: str, index: int, attempt: int) -> bool:
    return hmac.compare_digest(proof.encode(), _lease_proof(coordinator, index, attempt).encode())


def _of_another_recorder(coordinator: Coordinator, recorder: str, index: int) -> Verdict | None:
    """What is said to a recorder that is not the one of an episode."""
    chosen = coordinator.ledger.census.recorder_of(index)
    if unknown := _unknown_recorder(coordinator, recorder):
        return unknown
    if chosen in ("", recorder):
        return None
    return Verdict(status=VerdictStatus.STALE, reason=f"episode {index} is for {chosen}, not {recorder}")


def _unknown_recorder(coordinator: Coordinator, recorder: str) -> Verdict | None:
    """What is said to a recorder that the run has not, or has no more."""
    if recorder in coordinator.recorders:
        return None
    return Verdict(status=VerdictStatus.STALE, reason=f"the run has no recorder {recorder!r}")


def _presence(recorder: str) -> str:
    """Whose trouble it is when a recorder is gone."""
    return f"presence of {recorder}"


def _verdict(held: bool) -> Verdict:
    return Verdict(status=VerdictStatus.OK if held else VerdictStatus.STALE)


def _same_numeric_class(coordinator: Coordinator, numeric_class: str) -> bool:
    if numeric_class and not coordinator.numeric_class:
        coordinator.numeric_class = coordinator.ledger.notes.agree("numeric_class", numeric_class)
    return bool(numeric_class) and coordinator.numeric_class == numeric_class


def _planned_ahead(coordinator: Coordinator) -> bool:
    ahead = max(coordinator.config.plan_ahead, AHEAD_PER_PROCESS * coordinator.roster.size)
    return coordinator.ledger.census.begun() >= ahead


def _inputs(coordinator: Coordinator, lease: Lease) -> tuple[Blob, ...] | None:
    """What a stage needs, None if some of it is lost or damaged; what is fetched later is checked by who fetches."""
    inputs = []
    for sha256 in lease.inputs:
        size, data = coordinator.blobs.read(sha256, 0, coordinator.config.inline_bytes)
        inline = 0 <= size <= coordinator.config.inline_bytes
        if size < 0 or (inline and hashlib.sha256(data).hexdigest() != sha256):
            log.warning("result %s of episode %d is lost or damaged: it is begun anew", sha256, lease.index)
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
        lease=_lease_proof(coordinator, lease.index, lease.attempt),
    )


def _leased_policy(coordinator: Coordinator, lease: Lease) -> PolicyRef | None:
    own = coordinator.spec.policy
    if own is None or not lease.policy:
        return None
    (offered,) = (policy for policy in coordinator.ledger.policies.all() if policy.sha256 == lease.policy)
    return PolicyRef(path="", files=offered.files, mix=own.mix)


def _after_rejection(coordinator: Coordinator) -> None:
    rejected = sum(coordinator.ledger.census.rejections().values())
    accepted = coordinator.ledger.census.committed()[0] + coordinator.ledger.census.waiting_at(
        coordinator.spec.stages[-1]
    )
    if rejected >= coordinator.config.rejections_max and rejected > 20 * accepted:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in coordinator.ledger.census.rejections().items())
        coordinator.failed = f"{rejected} indices were rejected and {accepted} accepted: {reasons}."
        return
    coordinator.ledger.open_episodes(coordinator.wanted)
