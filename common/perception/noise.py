"""How a perception network errs about people: misses, errors of bearing and distance, false alarms."""

import math
from dataclasses import dataclass
from typing import Annotated

from readygo.common.config import Range, check_ranges

MISSED_AT_M = 4.0
"""Distance of `PerceptionNoise.missed`; the share of misses is proportional to the distance [m]."""
MISSED_MAX = 0.9
"""Largest share of misses, of people far away."""
CORRELATED_S = 0.1
"""Time of `PerceptionNoise.correlation` [s]."""


@dataclass(frozen=True, kw_only=True)
class PerceptionNoise:
    """Errors of perceived people. The defaults stand for a network that looks at the robot's images."""

    missed: Annotated[float, Range(low=0.0, high=1.0)] = 0.1
    """Share of looks that miss a visible person at a distance of 4 m; proportional to the distance."""
    bearing_deg: Annotated[float, Range(low=0.0, high=90.0)] = 3.0
    """Standard deviation of the bearing [deg]."""
    distance: Annotated[float, Range(low=0.0, high=1.0)] = 0.12
    """Standard deviation of the distance, as a share of it."""
    correlation: Annotated[float, Range(low=0.0, high=0.999)] = 0.9
    """Correlation of the errors about one person 0.1 s apart."""
    measures_velocity: bool = False
    """True if velocities are measured, not only places."""
    velocity_mps: Annotated[float, Range(low=0.0, high=5.0)] = 0.0
    """Standard deviation of measured velocities, per axis [m/s]."""
    false_alarms_hz: Annotated[float, Range(low=0.0, high=10.0)] = 0.0
    """People who are not there, per second [Hz]."""
    rate_hz: Annotated[float, Range(low=0.5, high=60.0)] = 10.0
    """Looks per second [Hz]."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def correlation_after(self, time_s: float) -> float:
        """Correlation of the errors about one person some time apart [s]."""
        return math.pow(self.correlation, time_s / CORRELATED_S)


PERCEIVED = PerceptionNoise()
"""A network that looks at images: places with errors, no velocities."""
EXACT = PerceptionNoise(missed=0.0, bearing_deg=0.0, distance=0.0, measures_velocity=True)
"""Exact places and velocities of visible people."""
