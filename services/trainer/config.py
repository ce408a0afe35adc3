"""How a policy is trained."""

import dataclasses
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Budget, optimisation and regularisation of one training run."""

    minutes: float = 10.0
    """Training time; runs that continue count the time of the earlier ones [min]."""
    epochs: int | None = None
    """Passes over the data instead of `minutes`; the result is then a function of data, config and threads."""
    seed: int = 0
    threads: int = 0
    """CPU threads; 0 takes every core that the process may use."""
    batch_size: int = 64
    chain_length: int = 8
    """Samples of one episode in a batch, one frame spacing apart, so that they share encoded frames."""
    learning_rate: float = 1e-3
    schedule: Literal["cosine", "constant"] = "cosine"
    """"cosine" warms up, then falls to a hundredth over the budget; "constant" keeps the learning rate."""
    weight_decay: float = 1e-4
    """Decoupled weight decay (AdamW); 0 is plain Adam."""
    ema_decay: float = 0.995
    """Decay per step of the averaged weights that are validated and exported; 0 exports the latest weights."""
    previous_dropout: float = 0.5
    """Probability that a training sample does not see the previous action (against copying it)."""
    previous_noise: float = 0.1
    """Standard deviation of the noise on the previous action in training, in units of its limits."""
    photometric: float = 0.2
    """Largest relative change of brightness, contrast and colour in training; 0 turns it off."""
    shift_px: int = 4
    """Largest shift of the images in training [px]; 0 turns it off."""
    yaw_error_rad: float = 0.1
    """Standard deviation of a yaw error that training images and goals are turned by [rad]; 0 turns it off."""
    yaw_gain_per_s: float = 2.0
    """Turn rate that the policy learns against a yaw error [1/s]."""
    hindsight: float = 0.5
    """Share of training samples whose goal is a place that the robot reached later."""
    mirror: float = 0.5
    """Probability that a batch is mirrored left to right in training, with goals and turns."""
    frame_spacing_s: float = 0.5
    """Time between the three frames that the policy sees [s]."""
    validation_fraction: float = 0.2
    """Share of the episodes that is held out when no validation data are given."""
    validation_samples: int = 2000
    """Most held-out samples that one validation looks at, spread evenly."""
    validate_every_steps: int = 100
    """Steps between validations; each also writes the checkpoint."""
    rollout_every: int = 5
    """Validations between closed-loop rollouts, where they choose the checkpoint."""
    cache_mb: int = 2048
    """Most memory for decoded frames; the rest is decoded anew for each batch [MB]."""

    def __post_init__(self) -> None:
        if self.epochs is None and not self.minutes > 0:
            raise ValueError(f"minutes must be positive, got {self.minutes}.")
        if self.epochs is not None and self.epochs < 1:
            raise ValueError(f"epochs must be at least 1, got {self.epochs}.")
        for name in ("batch_size", "chain_length", "validation_samples", "validate_every_steps", "rollout_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}.")
        for name in ("previous_dropout", "ema_decay", "validation_fraction", "photometric"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"{name} must be in [0, 1), got {getattr(self, name)}.")
        for name in ("mirror", "hindsight"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1], got {getattr(self, name)}.")
        for name in ("learning_rate", "frame_spacing_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")
        if min(self.threads, self.seed, self.cache_mb) < 0 or min(self.weight_decay, self.previous_noise) < 0:
            raise ValueError("threads, seed, cache_mb, weight_decay and previous_noise must not be negative.")


def paper_recipe(config: TrainConfig) -> TrainConfig:
    """The optimisation that the paper states, Adam at a constant 1e-4; what it leaves open is kept.

    Source: ReaDy-Go, section IV-B-2.
    """
    return dataclasses.replace(config, learning_rate=1e-4, schedule="constant", weight_decay=0.0)
