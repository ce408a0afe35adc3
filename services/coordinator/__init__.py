"""The coordinator: owns a run's ledger."""

from readygo.services.coordinator.blobs import BlobStore
from readygo.services.coordinator.config import CoordinatorConfig
from readygo.services.coordinator.coordinator import Coordinator
from readygo.services.coordinator.handlers import handle_status
from readygo.services.coordinator.ledger import Ledger
from readygo.services.coordinator.protocol import Holder, Written
from readygo.services.coordinator.service import attach, tick
from readygo.services.coordinator.upkeep import requeue_lost

__all__ = [
    "BlobStore",
    "Coordinator",
    "CoordinatorConfig",
    "Holder",
    "Ledger",
    "Written",
    "attach",
    "handle_status",
    "requeue_lost",
    "tick",
]
