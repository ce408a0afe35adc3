"""The coordinator on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import (
    BlobRequest,
    ClaimRequest,
    CompleteRequest,
    ControlRequest,
    DoneRequest,
    GrantRequest,
    LostRequest,
    PendingRequest,
    RenewRequest,
    RunSpecRequest,
    Stage,
    StatusRequest,
)
from readygo.services.coordinator import handlers
from readygo.services.coordinator.handlers import Coordinator


def attach(bus: Bus, coordinator: Coordinator) -> None:
    """Serve the run on `bus`."""
    bus.serve("coord/spec", RunSpecRequest, partial(handlers.handle_spec, coordinator))
    for stage in Stage:
        topic = f"coord/{stage.value}"
        bus.serve(f"{topic}/claim", ClaimRequest, partial(handlers.handle_claim, coordinator, stage))
        bus.serve(f"{topic}/renew", RenewRequest, partial(handlers.handle_renew, coordinator, stage))
        bus.serve(f"{topic}/complete", CompleteRequest, partial(handlers.handle_complete, coordinator, stage))
    bus.serve("coord/rec/grant", GrantRequest, partial(handlers.handle_grant, coordinator))
    bus.serve("coord/rec/done", DoneRequest, partial(handlers.handle_done, coordinator))
    bus.serve("coord/rec/lost", LostRequest, partial(handlers.handle_lost, coordinator))
    bus.serve("coord/rec/pending", PendingRequest, partial(handlers.handle_pending, coordinator))
    bus.serve("blob", BlobRequest, partial(handlers.handle_blob, coordinator))
    bus.serve("ctl", ControlRequest, partial(handlers.handle_control, coordinator))
    bus.serve("ctl/status", StatusRequest, partial(handlers.handle_status, coordinator))
