"""The coordinator: owns a run's ledger."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.coordinator.blobs import BlobStore as BlobStore
    from readygo.services.coordinator.config import CoordinatorConfig as CoordinatorConfig
    from readygo.services.coordinator.coordinator import Coordinator as Coordinator
    from readygo.services.coordinator.handlers import handle_fleet as handle_fleet
    from readygo.services.coordinator.handlers import handle_status as handle_status
    from readygo.services.coordinator.ledger import Ledger as Ledger
    from readygo.services.coordinator.protocol import Written as Written
    from readygo.services.coordinator.service import attach as attach
    from readygo.services.coordinator.service import tick as tick
else:
    _NAMES = {
        ".blobs": ("BlobStore",),
        ".config": ("CoordinatorConfig",),
        ".coordinator": ("Coordinator",),
        ".handlers": (
            "handle_fleet",
            "handle_status",
        ),
        ".ledger": ("Ledger",),
        ".protocol": ("Written",),
        ".service": (
            "attach",
            "tick",
        ),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
