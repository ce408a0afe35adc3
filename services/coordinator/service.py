"""The coordinator on the bus."""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from readygo.common.bus import Bus
from readygo.common.bus.identity import ALL, OPERATOR, RECORDER, TRAINER
from readygo.common.messages import StatusRequest, Verdict, Wake, topics
from readygo.services.coordinator import handlers
from readygo.services.coordinator.handlers import Coordinator, requeue_lost

Request = TypeVar("Request")


def attach(bus: Bus, coordinator: Coordinator) -> None:
    """Serve the run on `bus`, and free the leases of workers that leave."""
    bus.serve(topics.SPEC, partial(handlers.handle_spec, coordinator))
    for stage in coordinator.spec.stages:
        by = (stage.role, ALL)
        complete = _waking(bus, partial(handlers.handle_complete, coordinator, stage))
        bus.serve(topics.claim(stage.name), partial(handlers.handle_claim, coordinator, stage), by=by)
        bus.serve(topics.renew(stage.name), partial(handlers.handle_renew, coordinator), by=by)
        bus.serve(topics.complete(stage.name), complete, by=by)
    recorder = (RECORDER,)
    bus.serve(topics.EXPECT, partial(handlers.handle_expect, coordinator), by=recorder)
    bus.serve(topics.GRANT, partial(handlers.handle_grant, coordinator), by=recorder)
    bus.serve(topics.DONE, _waking(bus, partial(handlers.handle_done, coordinator)), by=recorder)
    bus.serve(topics.LOST, _waking(bus, partial(handlers.handle_lost, coordinator)), by=recorder)
    bus.serve(topics.TROUBLE, partial(handlers.handle_trouble, coordinator), by=recorder)
    bus.serve(topics.PENDING, partial(handlers.handle_pending, coordinator), by=recorder)
    workers = (*{stage.role for stage in coordinator.spec.stages}, ALL, RECORDER)
    bus.serve(topics.BLOB, partial(handlers.handle_blob, coordinator), by=workers)
    bus.serve(topics.OFFER, partial(handlers.handle_offer, coordinator), by=(TRAINER,))
    bus.serve(topics.CONTROL, _waking(bus, partial(handlers.handle_control, coordinator)), by=(OPERATOR,))
    bus.serve(topics.STATUS, partial(handlers.handle_status, coordinator))

    def changed(role: str, name: str, alive: bool) -> None:
        if name in coordinator.recorders:
            coordinator.note_recorder(name, alive=alive)
        elif not alive and requeue_lost(coordinator, worker=name):
            bus.publish(topics.WAKE, Wake())

    bus.watch(changed)


def _waking(bus: Bus, handler: Callable[[Request], Verdict]) -> Callable[[Request], Verdict]:
    """A handler after which there may be work for those who wait."""

    def handle(request: Request) -> Verdict:
        verdict = handler(request)
        bus.publish(topics.WAKE, Wake())
        return verdict

    return handle


def tick(bus: Bus, coordinator: Coordinator) -> None:
    """Free the leases that ran out, and say how far the run is; call it a few times a second."""
    if requeue_lost(coordinator):
        bus.publish(topics.WAKE, Wake())
    bus.publish(topics.PROGRESS, handlers.handle_status(coordinator, StatusRequest()))
