"""The bus between services; only this package imports zenoh."""

from readygo.common.bus.in_process import InProcessBus
from readygo.common.bus.interface import Bus
from readygo.common.bus.leases import StageResult, claim_once, fetch_blob, pull

__all__ = ["Bus", "InProcessBus", "StageResult", "claim_once", "fetch_blob", "pull"]
