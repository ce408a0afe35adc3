"""The driver: lets a policy or the expert drive, and asks the expert at every state what it would do."""

from readygo.services.driver.config import DriverConfig
from readygo.services.driver.disturbance import Disturbance, disturbs
from readygo.services.driver.handlers import AHEAD_STEPS, Advice, Camera, Drive, Expert, PolicyDriver, drive, driver_of

__all__ = [
    "AHEAD_STEPS",
    "Advice",
    "Camera",
    "Disturbance",
    "Drive",
    "DriverConfig",
    "Expert",
    "PolicyDriver",
    "disturbs",
    "drive",
    "driver_of",
]
