"""From settings to a trained policy."""

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from readygo.apps.run.origin import note_origin, origin_of_data
from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.extras import install_command
from readygo.services.trainer import TrainConfig, paper_recipe

if TYPE_CHECKING:
    from readygo.services.trainer.run import Evaluate, TrainProgress


def make_config(recipe: str, **settings: Any) -> TrainConfig:
    """The recipe's configuration with the settings that are not None.

    Raises:
        ConfigError: If a setting makes no sense.
    """
    try:
        config = paper_recipe(TrainConfig()) if recipe == "paper" else TrainConfig()
        return dataclasses.replace(config, **{name: value for name, value in settings.items() if value is not None})
    except ValueError as error:
        raise ConfigError(str(error)) from error


def run_training(
    data: tuple[Path, ...],
    config: TrainConfig,
    out: Path,
    *,
    val: tuple[Path, ...] = (),
    evaluate: "Evaluate | None" = None,
    show: "Callable[[TrainProgress], None] | None" = None,
) -> dict[str, Any]:
    """Train on data folders; returns what `metrics.json` holds.

    Raises:
        PolicyError: If torch or onnx is not installed, or `out` belongs to another run.
        DatasetError: If the data cannot be used.
    """
    # Threads that wait by spinning take the cores that the working ones need: on a shared machine training is 2.5
    # times faster without. libgomp reads this once, when torch loads it.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        from readygo.services.trainer.train import train as train_policy
    except ImportError as error:
        raise PolicyError(f"Training needs {error.name}; run: {install_command('train')}") from error
    validation = Dataset(val) if val else None
    metrics = train_policy(Dataset(data), config, out, validation=validation, evaluate=evaluate, report=show)
    note_origin(out, origin_of_data(data))
    return metrics
