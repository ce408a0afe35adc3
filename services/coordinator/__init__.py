"""The coordinator: owns a run's ledger."""

from services.coordinator.blobs import BlobStore
from services.coordinator.config import CoordinatorConfig
from services.coordinator.handlers import Coordinator, requeue_lost
from services.coordinator.ledger import Ledger
from services.coordinator.service import attach

__all__ = ["BlobStore", "Coordinator", "CoordinatorConfig", "Ledger", "attach", "requeue_lost"]
