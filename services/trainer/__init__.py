"""The trainer: policies from shards.

torch is imported by `readygo.services.trainer.train`, not here.
"""

from readygo.services.trainer.config import TrainConfig, paper_recipe

__all__ = ["TrainConfig", "paper_recipe"]
