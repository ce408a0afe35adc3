"""What measurements decide: which policy is kept, when learning ends, how many episodes a measurement has."""

from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.episode.metrics import wilson_interval

EPISODES_MIN = 4
"""Of a measurement, per task: fewer say nothing."""
MEASUREMENTS_MIN = 4
"""Measurements without a better one before learning ends early."""


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A policy on the split val."""

    fraction: float
    """Share of the budget that was spent when it was taken."""
    policy: str
    """SHA-256 over its files."""
    episodes: int
    """Per task."""
    static: float
    """Success rate without humans."""
    dynamic: float
    """Success rate among humans."""

    @property
    def score(self) -> float:
        """The lower end of the 95 % interval of the mean of both rates: what few episodes say counts for less."""
        low, _ = wilson_interval(round(self.episodes * (self.static + self.dynamic)), 2 * self.episodes)
        return low


def best_of(measurements: Sequence[Measurement]) -> int | None:
    """Row of the measurement whose policy is kept: the best score, the later one of equals; None without any."""
    rows = range(len(measurements))
    return max(rows, key=lambda row: (measurements[row].score, row), default=None)


def has_stopped_rising(measurements: Sequence[Measurement], fraction: float, patience: float) -> bool:
    """True if the score has not risen for the share `patience` of the budget, and for some measurements.

    Args:
        measurements: In the order in which they were taken.
        fraction: Share of the budget that is spent.
        patience: Share of the budget.
    """
    best = best_of(measurements)
    if best is None or len(measurements) - 1 - best < MEASUREMENTS_MIN:
        return False
    return fraction - measurements[best].fraction >= patience


def episodes_to_measure(seconds: float, episode_s: float, episodes_max: int) -> int:
    """Episodes per task that two tasks can have in a time, within sensible bounds.

    Args:
        seconds: Time that the measurement may take [s].
        episode_s: What one episode took so far [s].
        episodes_max: Upper bound.
    """
    return min(max(EPISODES_MIN, int(seconds / (2 * episode_s))), episodes_max)
