"""The learning rate over a training run: warm-up, a constant, and a fall at the end."""

from dataclasses import dataclass

from readygo.services.trainer.config import OptimizerConfig

WARM_UP_STEPS = 50
"""Steps over which the learning rate rises."""
FINAL_RATE = 0.01
"""Where the fall ends, as a share of the learning rate."""


@dataclass
class RateSchedule:
    """The learning rate by the share of the budget that is spent."""

    config: OptimizerConfig
    decay_from: float | None = None
    """Share of the budget after which the fall was begun early; None if it was not."""

    @property
    def end(self) -> float:
        """Share of the budget after which the run is over."""
        if self.decay_from is None or self.config.decay_share == 1:
            return 1.0
        return min(1.0, self.decay_from / (1 - self.config.decay_share))

    def begin_decay(self, fraction: float) -> None:
        """Begin the fall now, unless it has begun or nothing is spent; the run then ends as much earlier."""
        if self.decay_from is None and 0 < fraction < 1 - self.config.decay_share:
            self.decay_from = fraction

    def rescale(self, before: float, now: float) -> None:
        """Keep an early fall at its time when the budget changes; one that has ended is dropped, the rate rises again.

        Args:
            before: Share of the earlier budget that is spent.
            now: Share of the present budget that is spent.
        """
        if self.decay_from is not None:
            self.decay_from = None if before >= self.end else self.decay_from * now / before

    def rate(self, step: int, fraction: float) -> float:
        """Learning rate of a step, after the given share of the budget."""
        config = self.config
        warm_up = min(1.0, (step + 1) / WARM_UP_STEPS)
        begin = 1 - config.decay_share if self.decay_from is None else self.decay_from
        left = 1.0
        if config.decay_share > 0 and fraction > begin:
            left = max(0.0, (self.end - fraction) / max(self.end - begin, 1e-9))
        return config.learning_rate * warm_up * (FINAL_RATE + (1 - FINAL_RATE) * left)
