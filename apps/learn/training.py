"""The trainer's interface to the supervisor: its settings, its progress and its requests, as files."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.learn.plan import Budget, LearnPlan
from readygo.common.config import section_to_mapping
from readygo.common.documents import read_json, write_toml
from readygo.common.drawing.charts import Curve
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.perception.artifact import load_perception_spec
from readygo.services.trainer import (
    DECAY_FILE,
    PROGRESS_FILE,
    RECIPES,
    TrainConfig,
    best_recipe,
    loss_curves,
    with_overrides,
)

_HISTORY = ("samples", "train_loss", "validation_loss")
_NO_PROGRESS = (ValueError, TypeError, LookupError, AttributeError, OverflowError)
"""Exceptions that an invalid progress file causes."""
OFFERS = 60
"""Number of policies that are offered over the budget, if they are `OFFER_MIN_S` apart."""
OFFER_MIN_S = 15.0
"""Shortest processor time between two offered policies [s]."""


@dataclass(frozen=True, kw_only=True)
class Offered:
    """A policy that the trainer offered."""

    folder: Path
    sha256: str
    """SHA-256 by which the runs name the policy."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """Progress that the trainer reported last."""

    told_s: float = 0.0
    """Time of the report [s since 1970]."""
    ended: bool = False
    """True if the trainer's budget is spent."""
    fraction: float = 0.0
    """Share of its budget that is spent."""
    minutes: float = 0.0
    """Processor time per thread [min]."""
    samples: int = 0
    """Number of samples that training has used, repeats counted."""
    loss: float | None = None
    driven: float | None = None
    """Success rate of the latest episodes that policies drove: the mean of those with and without humans."""
    offered: Offered | None = None
    """The newest offered policy; None before the first."""

    @property
    def samples_hz(self) -> float:
        """Samples per second of one thread's processor time [Hz]; 0 while unknown."""
        return self.samples / (60 * self.minutes) if self.minutes > 0 else 0.0


def read_training(folder: Path, since_s: float = 0.0) -> Training:
    """Read the trainer's last report; default values before the first.

    Args:
        folder: Folder of the trainer.
        since_s: Start of the trainer [s since 1970]: the end of an earlier trainer is ignored.
    """
    path = folder / PROGRESS_FILE
    try:
        return _training_of(folder, read_json(path), path.stat().st_mtime, since_s)
    except (OSError, *_NO_PROGRESS):
        return Training()


def _training_of(folder: Path, told: Any, told_s: float, since_s: float) -> Training:
    rates = [entry["rate"] for entry in told["success"].values() if entry["rate"] is not None]
    losses = [entry["train_loss"] for entry in told["history"] if math.isfinite(entry["train_loss"])]
    taken = [offer for offer in told["offers"] if "sha256" in offer]
    return Training(
        told_s=told_s,
        ended=told["state"] == "ended" and told["fraction"] >= 1.0 and told_s >= since_s,
        fraction=told["fraction"],
        minutes=told["minutes"],
        samples=told["samples"],
        loss=losses[-1] if losses else None,
        driven=sum(rates) / len(rates) if rates else None,
        offered=Offered(folder=folder / taken[-1]["folder"], sha256=taken[-1]["sha256"]) if taken else None,
    )


def read_losses(folder: Path) -> list[Curve]:
    """Losses of training and of held-out episodes over samples; empty before the trainer's first validation.

    Args:
        folder: Folder of the trainer.
    """
    return loss_curves(read_history(folder))


def read_history(folder: Path) -> list[dict[str, Any]]:
    """Steps, samples and losses of the trainer's validations so far; empty before the first.

    Args:
        folder: Folder of the trainer.
    """
    try:
        history: list[dict[str, Any]] = read_json(folder / PROGRESS_FILE)["history"]
        return [entry for entry in history if all(isinstance(entry.get(name), int | float) for name in _HISTORY)]
    except (OSError, *_NO_PROGRESS):
        return []


def trainer_config(plan: LearnPlan, budget: Budget, perception: Path | None, threads: int = 0) -> TrainConfig:
    """The plan's recipe.

    Args:
        plan: Plan of the learning run.
        budget: Of the training.
        perception: Folder of trained perception whose network is the encoder; None for one that learns as well.
        threads: CPU threads; 0 takes every core.
    """
    return with_overrides(
        RECIPES[plan.recipe](),
        minutes=float(budget.minutes),
        samples=budget.samples,
        seed=plan.seed,
        threads=threads,
        offer_every_s=max(OFFER_MIN_S, 60 * budget.minutes / OFFERS),
        images=plan.learn.images,
        goal=plan.learn.goal,
        memory_count=plan.learn.memory,
        perception=str(perception.resolve()) if perception else None,
        frame_spacing_s=load_perception_spec(perception).spacing_s if perception else None,
    )


def write_trainer_config(plan: LearnPlan, threads: int) -> Path:
    """Write the trainer's settings, the plan's recipe with its budget; returns the file's path."""
    path = plan.out / "trainer.toml"
    config = trainer_config(plan, plan.budget, plan.perception, threads)
    write_toml(path, section_to_mapping(config), raises=RunError)
    return path


def decay_share() -> float:
    """The last share of a trainer's budget, over which its learning rate decays."""
    return best_recipe().optimizer.decay_share


def begin_decay(folder: Path) -> None:
    """Request the decay of the trainer's learning rate; training ends after the decay."""
    write_whole(folder / DECAY_FILE, "", raises=RunError)


def forget_decay(folder: Path) -> None:
    """Withdraw the request of `begin_decay` to an earlier trainer."""
    (folder / DECAY_FILE).unlink(missing_ok=True)
