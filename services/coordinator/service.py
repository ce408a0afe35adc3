"""The coordinator on the bus."""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from readygo.common.bus import Bus, Member
from readygo.common.bus.identity import ALL, MONITOR, OPERATOR, RECORDER, TRAINER
from readygo.common.messages import (
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    DoneRequest,
    OnRejection,
    RenewRequest,
    Stage,
    StatusRequest,
    Verdict,
    VerdictStatus,
    Wake,
    topics,
)
from readygo.services.coordinator import handlers
from readygo.services.coordinator.coordinator import Coordinator
from readygo.services.coordinator.protocol import Holder
from readygo.services.coordinator.upkeep import note_absent, requeue_lost

Request = TypeVar("Request")

TELL_S = 1.0
"""How far the run is, is said at least so often [s]."""


def attach(bus: Bus, coordinator: Coordinator) -> None:
    """Serve the run on `bus`, and free the leases of workers that leave."""
    bus.serve(topics.SPEC, partial(handlers.handle_spec, coordinator))
    for stage in coordinator.spec.stages:
        by = (stage.role, ALL)
        bus.serve(topics.claim(stage.name), partial(_serve_claim, coordinator, stage), by=by)
        bus.serve(topics.renew(stage.name), partial(_serve_renew, coordinator), by=by)
        bus.serve(topics.complete(stage.name), partial(_serve_complete, bus, coordinator, stage), by=by)
    recorder = (RECORDER,)
    bus.serve(topics.EXPECT, partial(handlers.handle_expect, coordinator), by=recorder)
    bus.serve(topics.GRANT, partial(handlers.handle_grant, coordinator), by=recorder)
    bus.serve(topics.DONE, partial(_serve_done, bus, coordinator), by=recorder)
    bus.serve(topics.LOST, _waking(bus, partial(handlers.handle_lost, coordinator)), by=recorder)
    bus.serve(topics.TROUBLE, partial(handlers.handle_trouble, coordinator), by=recorder)
    bus.serve(topics.PENDING, partial(handlers.handle_pending, coordinator), by=recorder)
    fetching = (*{stage.role for stage in coordinator.spec.stages}, ALL, RECORDER, MONITOR, OPERATOR)
    bus.serve(topics.BLOB, partial(handlers.handle_blob, coordinator), by=fetching)
    bus.serve(topics.OFFER, partial(handlers.handle_offer, coordinator), by=(TRAINER,))
    bus.serve(topics.CONTROL, _waking(bus, partial(handlers.handle_control, coordinator)), by=(OPERATOR,))
    bus.serve(topics.STATUS, partial(handlers.handle_status, coordinator))
    bus.serve(topics.FLEET, partial(handlers.handle_fleet, coordinator))

    def on_member_change(member: Member, alive: bool) -> None:
        there = coordinator.roster.note_presence(member.role, member.name, member.session, alive=alive)
        holder = Holder(worker=member.name, role=member.role, session=member.session)
        if member.role == RECORDER:
            if member.name in coordinator.recorders:
                coordinator.note_recorder(member.name, alive=there)
        elif not alive and requeue_lost(coordinator, holder=holder):
            bus.publish(topics.WAKE, Wake())

    bus.watch(on_member_change)


def _serve_claim(coordinator: Coordinator, stage: Stage, request: ClaimRequest) -> ClaimReply:
    reply = handlers.handle_claim(coordinator, stage, request)
    coordinator.roster.note_heard(request.role, request.worker)
    if reply.episode is not None:
        coordinator.roster.note_lease(request.role, request.worker, reply.episode.index, reply.attempt)
    return reply


def _serve_renew(coordinator: Coordinator, request: RenewRequest) -> Verdict:
    verdict = handlers.handle_renew(coordinator, request)
    if verdict.status is VerdictStatus.OK:
        coordinator.roster.note_renewed(request.index, request.attempt)
    return verdict


def _serve_complete(bus: Bus, coordinator: Coordinator, stage: Stage, request: CompleteRequest) -> Verdict:
    verdict = handlers.handle_complete(coordinator, stage, request)
    if verdict.status is VerdictStatus.OK:
        coordinator.roster.note_done(stage.name, request.index, request.attempt, failed=bool(request.failed))
        skipped = request.rejected and stage.on_rejection is OnRejection.SKIP
        line = coordinator.spec.stages
        if request.failed or skipped:
            _wake(bus, coordinator, line[0])
        elif not stage.records:
            _wake(bus, coordinator, line[line.index(stage) + 1])
    return verdict


def _serve_done(bus: Bus, coordinator: Coordinator, request: DoneRequest) -> Verdict:
    verdict = handlers.handle_done(coordinator, request)
    # One episode less is under way: the next one may be planned.
    _wake(bus, coordinator, coordinator.spec.stages[0])
    return verdict


def _wake(bus: Bus, coordinator: Coordinator, stage: Stage) -> None:
    """Say that something may wait for a stage, or that nothing will any more for any."""
    bus.publish(topics.WAKE, Wake() if coordinator.over else Wake(stages=(stage.name,)))


def _waking(bus: Bus, handler: Callable[[Request], Verdict]) -> Callable[[Request], Verdict]:
    """A handler after which there may be work for those who wait."""

    def handle(request: Request) -> Verdict:
        verdict = handler(request)
        bus.publish(topics.WAKE, Wake())
        return verdict

    return handle


def tick(bus: Bus, coordinator: Coordinator) -> None:
    """Free the leases that ran out, and say how far the run is; call it a few times a second.

    It is said when something of note has changed, else once a second: to count what waits takes time in long runs.
    """
    if requeue_lost(coordinator):
        bus.publish(topics.WAKE, Wake())
    now_s = coordinator.clock()
    of_note = (
        coordinator.ledger.census.committed_counts()[0],
        coordinator.over,
        coordinator.paused,
        tuple(coordinator.troubles),
    )
    if of_note != coordinator.told or now_s - coordinator.told_s >= TELL_S:
        coordinator.told, coordinator.told_s = of_note, now_s
        note_absent(coordinator)
        bus.publish(topics.PROGRESS, handlers.handle_status(coordinator, StatusRequest()))
