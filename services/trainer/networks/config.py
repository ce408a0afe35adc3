"""How the published networks are trained."""

from dataclasses import dataclass
from typing import Annotated

from readygo.common.config import Range, check_ranges
from readygo.services.trainer.config import MINUTES

LEARNING_RATES = {"gnm": 7e-4, "vint": 5e-4, "nomad": 1e-4}
"""Learning rates as published, by network."""
GOAL_LOOKS_MAX = 20
"""Farthest goal of a sample, in looks; goals out of another trajectory count as far away as that."""


@dataclass(frozen=True, kw_only=True)
class NetworkTrainConfig:
    """One training run of a network."""

    network: str
    """gnm, vint or nomad."""
    minutes: Annotated[float, MINUTES] = 10.0
    """Processor time of each thread; runs that continue count that of the earlier ones [min]."""
    samples: int | None = None
    """Samples to be shown instead of `minutes`."""
    batch_size: Annotated[int, Range(low=2)] = 32
    """Samples per step; the published 256 take a step every minute on a CPU core."""
    learning_rate: float | None = None
    """The published one by default, see `LEARNING_RATES`."""
    seed: Annotated[int, Range(low=0)] = 0
    threads: Annotated[int, Range(low=0)] = 0
    """CPU threads; 0 takes every core that the process may use."""
    cache_mb: Annotated[int, Range(low=0)] = 1024
    """Most memory for decoded images [MB]."""

    def __post_init__(self) -> None:
        if self.network not in LEARNING_RATES:
            raise ValueError(f"network must be one of {', '.join(LEARNING_RATES)}, got {self.network!r}.")
        check_ranges(self)
        if self.samples is not None and self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}.")
        if self.learning_rate is not None and not self.learning_rate > 0:
            raise ValueError(f"learning_rate must be positive, got {self.learning_rate}.")
