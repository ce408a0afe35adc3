"""The bus between services; only this package imports zenoh."""

from common.bus.in_process import InProcessBus
from common.bus.interface import Bus
from common.bus.leases import StageResult, claim_once, fetch_blob, pull

__all__ = ["Bus", "InProcessBus", "StageResult", "claim_once", "fetch_blob", "pull"]
