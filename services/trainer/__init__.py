"""The trainer: policies from episodes.

torch is imported with the names that need it, not here.
"""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.trainer.config import CHECKPOINT_FILE as CHECKPOINT_FILE
    from readygo.services.trainer.config import MINUTES as MINUTES
    from readygo.services.trainer.config import RECIPES as RECIPES
    from readygo.services.trainer.config import NetworkConfig as NetworkConfig
    from readygo.services.trainer.config import SamplingConfig as SamplingConfig
    from readygo.services.trainer.config import TrainConfig as TrainConfig
    from readygo.services.trainer.config import best_recipe as best_recipe
    from readygo.services.trainer.config import with_overrides as with_overrides
    from readygo.services.trainer.history import DECAY_FILE as DECAY_FILE
    from readygo.services.trainer.history import PROGRESS_FILE as PROGRESS_FILE
    from readygo.services.trainer.history import loss_curves as loss_curves
    from readygo.services.trainer.image_choice import chosen_images as chosen_images
    from readygo.services.trainer.live import LiveTrainer as LiveTrainer
    from readygo.services.trainer.networks.config import NetworkTrainConfig as NetworkTrainConfig
    from readygo.services.trainer.networks.train import train_network as train_network
    from readygo.services.trainer.perception.config import PerceptionConfig as PerceptionConfig
    from readygo.services.trainer.perception.looks import RecordedScene as RecordedScene
    from readygo.services.trainer.perception.looks import image_bytes as image_bytes
    from readygo.services.trainer.perception.looks import looks_of as looks_of
    from readygo.services.trainer.perception.train import PerceptionProgress as PerceptionProgress
    from readygo.services.trainer.perception.train import PerceptionRun as PerceptionRun
    from readygo.services.trainer.pretrained import perception_weights as perception_weights
    from readygo.services.trainer.ranks import join_ranks as join_ranks
    from readygo.services.trainer.ranks import leave_ranks as leave_ranks
    from readygo.services.trainer.reinforcement.config import ReinforcementConfig as ReinforcementConfig
    from readygo.services.trainer.reinforcement.run import Budget as Budget
    from readygo.services.trainer.reinforcement.run import Place as Place
    from readygo.services.trainer.reinforcement.run import Training as Training
    from readygo.services.trainer.run import Evaluate as Evaluate
    from readygo.services.trainer.run import TrainProgress as TrainProgress
    from readygo.services.trainer.train import train_policy as train_policy
    from readygo.services.trainer.train import training_threads as training_threads
else:
    _NAMES = {
        ".config": (
            "CHECKPOINT_FILE",
            "MINUTES",
            "RECIPES",
            "NetworkConfig",
            "SamplingConfig",
            "TrainConfig",
            "best_recipe",
            "with_overrides",
        ),
        ".history": (
            "DECAY_FILE",
            "PROGRESS_FILE",
            "loss_curves",
        ),
        ".image_choice": ("chosen_images",),
        ".live": ("LiveTrainer",),
        ".networks.config": ("NetworkTrainConfig",),
        ".networks.train": ("train_network",),
        ".perception.config": ("PerceptionConfig",),
        ".perception.looks": (
            "RecordedScene",
            "image_bytes",
            "looks_of",
        ),
        ".perception.train": (
            "PerceptionProgress",
            "PerceptionRun",
        ),
        ".pretrained": ("perception_weights",),
        ".ranks": (
            "join_ranks",
            "leave_ranks",
        ),
        ".reinforcement.config": ("ReinforcementConfig",),
        ".reinforcement.run": (
            "Budget",
            "Place",
            "Training",
        ),
        ".run": (
            "Evaluate",
            "TrainProgress",
        ),
        ".train": (
            "train_policy",
            "training_threads",
        ),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
