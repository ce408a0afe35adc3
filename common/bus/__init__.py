"""The bus between services; only this package imports zenoh."""

from common.bus.in_process import InProcessBus
from common.bus.interface import Bus

__all__ = ["Bus", "InProcessBus"]
