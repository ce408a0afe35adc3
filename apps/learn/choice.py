"""Decisions from measurements: the policy to keep, the end of training, the number of episodes of a measurement."""

from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.episode.metrics import wilson_interval

EPISODES_MIN = 4
"""Smallest number of episodes per task of a measurement; fewer have no significance."""
MEASUREMENTS_MIN = 4
"""Measurements without a better one before learning ends early."""
GAIN = 0.05
"""Rise of the success rate that must be unlikely before learning ends early."""


@dataclass(frozen=True, kw_only=True)
class PolicyMeasurement:
    """Success rates of a policy on the split val."""

    fraction: float
    """Share of the budget that was spent at the measurement."""
    policy: str
    """SHA-256 over its files."""
    episodes: int
    """Number of episodes per task."""
    static: float
    """Success rate without humans."""
    dynamic: float
    """Success rate among humans."""

    @property
    def successes(self) -> int:
        """Number of successful episodes of both tasks."""
        return round(self.episodes * (self.static + self.dynamic))

    @property
    def score(self) -> float:
        """Lower end of the 95 % interval of the mean of both rates, which penalises few episodes."""
        low, _ = wilson_interval(self.successes, 2 * self.episodes)
        return low


def best_of(measurements: Sequence[PolicyMeasurement]) -> int | None:
    """Index of the measurement with the best score, the later one of equals; None without measurements."""
    rows = range(len(measurements))
    return max(rows, key=lambda row: (measurements[row].score, row), default=None)


def has_stopped_rising(measurements: Sequence[PolicyMeasurement], fraction: float, patience: float) -> bool:
    """True if the score has not risen for the share `patience` of the budget, and for some measurements.

    A measurement of a few episodes hardly ever has the best score. So those since the best one, taken together, must
    also tell that the success rate did not rise by `GAIN`, with the confidence of a 95 % interval.

    Args:
        measurements: In the order in which they were taken.
        fraction: Share of the budget that is spent.
        patience: Share of the budget.
    """
    best = best_of(measurements)
    if best is None or len(measurements) - 1 - best < MEASUREMENTS_MIN:
        return False
    later, before = measurements[best + 1 :], measurements[best]
    _, high = wilson_interval(sum(m.successes for m in later), 2 * sum(m.episodes for m in later))
    rose = high >= before.successes / (2 * before.episodes) + GAIN
    return fraction - before.fraction >= patience and not rose


def episodes_to_measure(seconds: float, episode_s: float, episodes_max: int) -> int:
    """Number of episodes per task for two tasks in a given time, within bounds.

    Args:
        seconds: Time that the measurement may take [s].
        episode_s: Mean time of an episode so far [s].
        episodes_max: Upper bound.
    """
    return min(max(EPISODES_MIN, int(seconds / (2 * episode_s))), episodes_max)
