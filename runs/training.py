"""Trains policies from settings."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.extras import install_command
from readygo.runs.methods import NETWORKS
from readygo.runs.sections import NO_KEYS, Keys, with_file, with_keys
from readygo.services.trainer import RECIPES, NetworkTrainConfig, TrainConfig, with_overrides

if TYPE_CHECKING:
    from readygo.services.trainer import Evaluate, TrainProgress


def make_config(recipe: str, file: Path | None = None, keys: Keys = NO_KEYS, **settings: Any) -> TrainConfig:
    """The recipe's configuration, overridden by a file, by the settings that are not None, and by keys.

    Args:
        recipe: One of `RECIPES`.
        file: TOML file with fields of `TrainConfig`.
        keys: Keys of the command line.
        settings: Fields of `TrainConfig` or of its sections.

    Raises:
        ConfigError: If the file cannot be read, or a setting is invalid.
    """
    config = with_file(RECIPES[recipe](), file)
    try:
        config = with_overrides(config, **settings)
    except ValueError as error:
        raise ConfigError(_of_option(error, settings)) from error
    return with_keys(config, keys)


def default_recipe(dataset: Dataset) -> str:
    """Default recipe for a dataset: "best" if it has expert labels at every state, else "fast"."""
    return "best" if dataset.has_expert else "fast"


def run_training(
    dataset: Dataset,
    config: TrainConfig,
    out: Path,
    *,
    val: tuple[Path, ...] = (),
    evaluate: "Evaluate | None" = None,
    evaluated: str = "",
    show: "Callable[[TrainProgress], None] | None" = None,
) -> dict[str, Any]:
    """Train on recorded episodes; returns the content of `metrics.json`, empty in helper processes of a training.

    Args:
        dataset: Recorded episodes.
        config: Budget and settings.
        out: Folder of the policy.
        val: Data folders for validation; without them episodes are held out.
        evaluate: Closed-loop success rate, which chooses the weights; None takes the last ones.
        evaluated: Names the episodes that `evaluate` drives.
        show: Told about every step.

    Raises:
        PolicyError: If torch or onnx is not installed, or `out` belongs to another run.
        DatasetError: If the data cannot be used.
    """
    validation = Dataset(val) if val else None
    with torch_needed():
        from readygo.services.trainer import join_ranks, leave_ranks, train_policy
    together = "WORLD_SIZE" in os.environ
    if together:
        join_ranks(config.device)
    metrics = train_policy(
        dataset, config, out, validation=validation, evaluate=evaluate, evaluated=evaluated, report=show
    )
    if together:
        leave_ranks()
    return metrics


def make_network_config(name: str, settings: Mapping[str, Any]) -> NetworkTrainConfig:
    """The settings of training a published network.

    Args:
        name: One of `NETWORKS`.
        settings: Fields of `NetworkTrainConfig`; None keeps the published value.

    Raises:
        ConfigError: If a setting is invalid.
    """
    try:
        return NetworkTrainConfig(network=name, **{k: v for k, v in settings.items() if v is not None})
    except ValueError as error:
        raise ConfigError(_of_option(error, settings)) from error


def _of_option(error: ValueError, settings: Mapping[str, Any]) -> str:
    """An error in words that begin with the option where it is of a setting."""
    name, _, words = str(error).partition(" ")
    return f"--{name.replace('_', '-')} {words}" if name in settings else str(error)


def run_network_training(
    dataset: Dataset, config: NetworkTrainConfig, out: Path, show: "Callable[[TrainProgress], None]"
) -> dict[str, Any]:
    """Train a published network, and write its weights to the file that evaluations read from a folder.

    Raises:
        PolicyError: If torch is not installed, or the folder belongs to another run.
        DatasetError: If the data cannot be used.
    """
    with torch_needed():
        from readygo.services.trainer import train_network
    return train_network(dataset, config, out / NETWORKS[config.network], show)


@contextmanager
def torch_needed() -> Iterator[None]:
    """Context for imports of the trainer's modules that need torch.

    Raises:
        PolicyError: If torch or onnx is not installed.
    """
    # Spinning threads take cores from working ones: on a shared machine training is 2.5 times faster without spinning.
    # libgomp reads this variable once, when torch loads it.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        yield
    except ImportError as error:
        raise PolicyError(f"Training needs {error.name}; run: {install_command('train')}") from error
