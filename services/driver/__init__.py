"""The driver: lets a policy or the expert drive, and asks the expert at every state what it would do."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.driver.config import DriverConfig as DriverConfig
    from readygo.services.driver.disturbance import Disturbance as Disturbance
    from readygo.services.driver.disturbance import disturbs as disturbs
    from readygo.services.driver.handlers import EpisodeDrive as EpisodeDrive
    from readygo.services.driver.handlers import LabellingExpert as LabellingExpert
    from readygo.services.driver.handlers import drive as drive
    from readygo.services.driver.handlers import driver_of as driver_of
    from readygo.services.driver.risks import RiskMap as RiskMap
    from readygo.services.driver.teacher import StateTeacher as StateTeacher
else:
    _NAMES = {
        ".config": ("DriverConfig",),
        ".disturbance": (
            "Disturbance",
            "disturbs",
        ),
        ".handlers": (
            "EpisodeDrive",
            "LabellingExpert",
            "drive",
            "driver_of",
        ),
        ".risks": ("RiskMap",),
        ".teacher": ("StateTeacher",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
