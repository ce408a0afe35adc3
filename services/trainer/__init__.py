"""The trainer: policies from episodes.

torch is imported by `readygo.services.trainer.train` and `readygo.services.trainer.live`, not here.
"""

from readygo.services.trainer.config import (
    RECIPES,
    TrainConfig,
    best_recipe,
    fast_recipe,
    paper_recipe,
    with_overrides,
)

__all__ = ["RECIPES", "TrainConfig", "best_recipe", "fast_recipe", "paper_recipe", "with_overrides"]
