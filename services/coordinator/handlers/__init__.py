"""Requests to the coordinator -> replies."""

from readygo.services.coordinator.handlers.recorders import (
    handle_done,
    handle_expect,
    handle_grant,
    handle_lost,
    handle_pending,
    handle_trouble,
)
from readygo.services.coordinator.handlers.run import (
    handle_blob,
    handle_control,
    handle_fleet,
    handle_offer,
    handle_spec,
    handle_status,
)
from readygo.services.coordinator.handlers.workers import handle_claim, handle_complete, handle_renew

__all__ = [
    "handle_blob",
    "handle_claim",
    "handle_complete",
    "handle_control",
    "handle_done",
    "handle_expect",
    "handle_fleet",
    "handle_grant",
    "handle_lost",
    "handle_offer",
    "handle_pending",
    "handle_renew",
    "handle_spec",
    "handle_status",
    "handle_trouble",
]
