"""From recorded episodes to the weights of GNM, ViNT or NoMaD, in the layout that their authors offer."""

import copy
import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from readygo.common.cores import available_cores
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError, DiskError, PolicyError
from readygo.common.networks.checkpoint import load_network, save_network
from readygo.common.networks.models import NETWORKS
from readygo.services.trainer.checkpoint import read_state, refuse_damaged, write_state
from readygo.services.trainer.networks.config import LEARNING_RATES, NetworkTrainConfig
from readygo.services.trainer.networks.losses import PLACES, loss_of
from readygo.services.trainer.networks.samples import Looks, NetworkBatch, Pictures, choose, looks_of, make_batch
from readygo.services.trainer.run import TrainProgress
from readygo.services.trainer.samples import held_out_names

EMA_POWER, EMA_MAX = 0.75, 0.9999
"""NoMaD's averaged weights follow by 1 - (step + 1)^-power."""
SAVE_EVERY_S = 120.0
"""Processor time after which the weights are written [s]."""
VALIDATION_FRACTION = 0.1
"""Share of the episodes that is held out."""
VALIDATION_SAMPLES = 256
STEERED = 2
"""The place that a robot steers at, see `readygo.services.evaluator.network_driver`."""
Report = Callable[[TrainProgress], None]


@dataclass
class NetworkRun:
    """What a run of training has come to."""

    network: Any
    optimizer: torch.optim.Optimizer
    averaged: Any = None
    """NoMaD's averaged weights."""
    samples: int = 0
    steps: int = 0
    spent_s: float = 0.0
    """Processor time of each thread [s]."""
    losses: list[float] = field(default_factory=list)
    """Mean of every hundred steps."""

    @property
    def best(self) -> Any:
        """The weights that drive."""
        return self.averaged or self.network


def train_network(
    dataset: Dataset, config: NetworkTrainConfig, path: Path, report: Report = lambda progress: None
) -> dict[str, Any]:
    """Train a network, or continue where an earlier call with the same `path` stopped.

    Weights that lie at `path` and are of no earlier run, such as the published ones, are what training begins with.

    Args:
        dataset: Recorded episodes; those that the expert drove are learned from.
        config: Budget and settings.
        path: File of the weights; what continues a run lies beside it, with ".training" behind its name.
        report: Told about every step.

    Returns:
        What was done, as plain values.

    Raises:
        DatasetError: If the data hold too few episodes.
        PolicyError: If what lies at `path` is of other data or settings or no such network, or the loss is not finite.
        DiskError: If the weights cannot be written.
    """
    torch.set_num_threads(config.threads or available_cores())
    names = [entry.episode.episode_id for entry in dataset.episodes]
    held_out = held_out_names(names, VALIDATION_FRACTION)
    run = _begin(config, path, dataset.content_hash)
    learner = _Learner(dataset, looks_of(dataset, set(names) - held_out), config)
    saved_s, loss = run.spent_s, math.nan
    while (share := _share(run, config)) < 1.0:
        loss = learner.step(run)
        progress = TrainProgress(fraction=share, step=run.steps, train_loss=loss, validation_loss=math.nan)
        report(progress)
        if run.spent_s - saved_s > SAVE_EVERY_S:
            saved_s = run.spent_s
            _save(run, config, path, dataset.content_hash)
    _save(run, config, path, dataset.content_hash)
    measured = _measure(dataset, held_out, config, run)
    parameters = sum(parameter.numel() for parameter in run.network.parameters())
    return {
        "network": config.network,
        "parameters": parameters,
        "samples_seen": run.samples,
        "steps": run.steps,
        "elapsed_s": round(run.spent_s, 1),
        "episodes": len(names) - len(held_out),
        "loss": run.losses[-1] if run.losses else loss,
        **measured,
    }


class _Learner:
    """Steps of training on some looks."""

    def __init__(self, dataset: Dataset, looks: Looks, config: NetworkTrainConfig) -> None:
        size = NETWORKS[config.network]
        self._pictures = Pictures(dataset, looks, size.width_px, size.height_px, config.cache_mb)
        self.looks, self._config, self._recent = looks, config, list[float]()

    def batch(self, count: int, rng: np.random.Generator) -> NetworkBatch:
        """Draw a batch of samples."""
        name = self._config.network
        choice = choose(self.looks, count, rng)
        return make_batch(self.looks, self._pictures, choice, frames=NETWORKS[name].frames, places=PLACES[name])

    def step(self, run: NetworkRun) -> float:
        """One step: its draws are a function of seed and step, so that a run may be continued."""
        config = self._config
        begin_s = time.process_time()
        generator = torch.Generator().manual_seed(config.seed * 1_000_003 + run.steps)
        torch.manual_seed(config.seed * 1_000_003 + run.steps)
        batch = self.batch(config.batch_size, np.random.default_rng([config.seed, run.steps]))
        run.network.train()
        loss = loss_of(config.network, run.network, batch, generator)
        value = float(loss.detach())
        if not math.isfinite(value):
            raise PolicyError(
                f"The loss is {value} after {run.samples} samples; try a smaller --optimizer.learning-rate."
            )
        run.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        run.optimizer.step()
        run.steps, run.samples = run.steps + 1, run.samples + config.batch_size
        if run.averaged is not None:
            _follow(run.averaged, run.network, min(1 - (run.steps + 1) ** -EMA_POWER, EMA_MAX))
        self._recent = [*self._recent, value][-100:]
        if run.steps % 100 == 0:
            run.losses.append(round(float(np.mean(self._recent)), 6))
        run.spent_s += (time.process_time() - begin_s) / torch.get_num_threads()
        return value


def _share(run: NetworkRun, config: NetworkTrainConfig) -> float:
    """Share of the budget that is spent."""
    return run.samples / config.samples if config.samples else run.spent_s / (60 * config.minutes)


def _follow(averaged: torch.nn.Module, network: torch.nn.Module, decay: float) -> None:
    with torch.no_grad():
        for ours, theirs in zip(averaged.state_dict().values(), network.state_dict().values(), strict=True):
            if ours.is_floating_point():
                ours.lerp_(theirs, 1 - decay)
            else:
                ours.copy_(theirs)


def _begin(config: NetworkTrainConfig, path: Path, data: str) -> NetworkRun:
    """A run at its beginning, or where it stopped."""
    torch.manual_seed(config.seed)
    kept = _kept_samples(path, config, data)
    network: Any = load_network(config.network, path) if path.exists() and not kept else NETWORKS[config.network]()
    rate = config.learning_rate or LEARNING_RATES[config.network]
    run = NetworkRun(network=network, optimizer=torch.optim.AdamW(network.parameters(), lr=rate))
    if config.network == "nomad":
        run.averaged = copy.deepcopy(network)
    if not kept:
        return run
    with refuse_damaged(_training_file(path)):
        network.load_state_dict(kept["network"])
        run.optimizer.load_state_dict(kept["optimizer"])
        run.samples, run.steps, run.spent_s = kept["samples"], kept["steps"], kept["spent_s"]
        run.losses = list(kept["losses"])
        if run.averaged is not None:
            run.averaged.load_state_dict(kept["averaged"])
    return run


def _kept_samples(path: Path, config: NetworkTrainConfig, data: str) -> dict[str, Any]:
    """What continues a run; empty without one."""
    file = _training_file(path)
    if not file.exists():
        return {}
    kept = read_state(file)
    with refuse_damaged(file):
        theirs = kept["data"], kept["settings"]
    if theirs != (data, _settings(config)):
        raise PolicyError(f"{file} is of a run with other data or settings; choose another --out.")
    return kept


def _save(run: NetworkRun, config: NetworkTrainConfig, path: Path, data: str) -> None:
    state = {
        "data": data,
        "settings": _settings(config),
        "network": run.network.state_dict(),
        "optimizer": run.optimizer.state_dict(),
        "averaged": run.averaged.state_dict() if run.averaged is not None else {},
        "samples": run.samples,
        "steps": run.steps,
        "spent_s": run.spent_s,
        "losses": run.losses,
    }
    save_network(run.best, path)
    write_state(state, _training_file(path), raises=DiskError)


def _training_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.training")


def _settings(config: NetworkTrainConfig) -> dict[str, Any]:
    """What a run that continues must have alike."""
    free = ("minutes", "samples", "threads", "cache_mb")
    return {name: value for name, value in dataclasses.asdict(config).items() if name not in free}


def _measure(dataset: Dataset, held_out: set[str], config: NetworkTrainConfig, run: NetworkRun) -> dict[str, float]:
    """How far from where the expert went the network steers in held-out episodes, and how far off the mean place is.

    Nothing where there are fewer than two such episodes that the expert drove for long enough.
    """
    try:
        looks = looks_of(dataset, held_out)
    except DatasetError:
        return {}
    learner = _Learner(dataset, looks, config)
    batch = learner.batch(VALIDATION_SAMPLES, np.random.default_rng(config.seed))
    seen = ~batch.other
    run.best.eval()
    with torch.inference_mode():
        generator = torch.Generator().manual_seed(config.seed)
        places = run.best.waypoints(batch.images[seen], batch.goals[seen], generator)[:, STEERED, :2]
    went, unit_m = batch.places[seen][:, STEERED, :2], learner.looks.unit_m
    mean = went.mean(dim=0)
    return {
        "held_out_episodes": len(held_out),
        "waypoint_error_m": round(float((places - went).norm(dim=1).mean()) * unit_m, 4),
        "waypoint_error_of_mean_m": round(float((mean - went).norm(dim=1).mean()) * unit_m, 4),
    }
