"""The bus between services; only this package imports zenoh."""

from readygo.common.bus.identity import Member
from readygo.common.bus.in_process import InProcessBus
from readygo.common.bus.interface import Bus

__all__ = ["Bus", "InProcessBus", "Member"]
