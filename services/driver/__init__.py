"""The driver: lets a policy or the expert drive, and asks the expert at every state what it would do."""

from readygo.services.driver.config import DriverConfig
from readygo.services.driver.disturbance import Disturbance, disturbs
from readygo.services.driver.handlers import (
    AHEAD_STEPS,
    Advice,
    Camera,
    Drive,
    Expert,
    PolicyDriver,
    Weigher,
    drive,
    driver_of,
)
from readygo.services.driver.risks import RiskMap

__all__ = [
    "AHEAD_STEPS",
    "Advice",
    "Camera",
    "Disturbance",
    "Drive",
    "DriverConfig",
    "Expert",
    "PolicyDriver",
    "RiskMap",
    "Weigher",
    "disturbs",
    "drive",
    "driver_of",
]
