"""The trainer of a run that learns, from outside: its settings, how far it says to be, what it is asked to do."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.learn.plan import Plan
from readygo.common.documents import read_json
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.services.trainer import best_recipe

_HISTORY = ("samples", "train_loss", "validation_loss")
_NO_PROGRESS = (ValueError, TypeError, LookupError, AttributeError, OverflowError)
"""What a progress file of another shape raises."""
PROGRESS_FILE, DECAY_FILE = "progress.json", "decay"
"""What the trainer writes, and what has its learning rate fall; see `readygo.services.trainer.live`."""
OFFERS = 60
"""Policies that are offered over the budget, as long as they come `OFFER_MIN_S` apart."""
OFFER_MIN_S = 15.0
"""Shortest processor time between two of them [s]."""


@dataclass(frozen=True, kw_only=True)
class Offered:
    """A policy that the trainer offered."""

    folder: Path
    sha256: str
    """What the runs call it."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """How far the trainer said to be."""

    told_s: float = 0.0
    """When it said so, since the epoch [s]."""
    ended: bool = False
    """True if its budget is spent."""
    fraction: float = 0.0
    """Share of its budget that is spent."""
    minutes: float = 0.0
    """Processor time of each of its threads [min]."""
    samples: int = 0
    """Samples that it learned from, repeats counted."""
    loss: float | None = None
    driven: float | None = None
    """Success rate of the latest episodes that policies drove: the mean of those with and without humans."""
    offered: Offered | None = None
    """The newest policy."""

    @property
    def samples_hz(self) -> float:
        """Samples per second of each thread's time; 0 if not known yet."""
        return self.samples / (60 * self.minutes) if self.minutes > 0 else 0.0


def read_training(folder: Path, since_s: float = 0.0) -> Training:
    """What the trainer wrote last; nothing is known before it did.

    Args:
        folder: The trainer's.
        since_s: When it was started, since the epoch [s]: that an earlier one had ended says nothing.
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


def read_history(folder: Path) -> list[dict[str, Any]]:
    """Steps, samples and losses of the trainer's validations so far; none if it wrote nothing.

    Args:
        folder: The trainer's.
    """
    try:
        history: list[dict[str, Any]] = read_json(folder / PROGRESS_FILE)["history"]
        return [entry for entry in history if all(isinstance(entry.get(name), int | float) for name in _HISTORY)]
    except (OSError, *_NO_PROGRESS):
        return []


def write_trainer_config(plan: Plan, threads: int) -> Path:
    """Write the trainer's settings, those of the recipe "best" with the run's budget, and say where."""
    budget = plan.budget
    samples = [f"samples = {budget.samples}"] if budget.samples is not None else []
    lines = [
        f"minutes = {float(budget.minutes)!r}",
        *samples,
        f"seed = {plan.seed}",
        f"threads = {threads}",
        "[live]",
        f"offer_every_s = {max(OFFER_MIN_S, 60 * budget.minutes / OFFERS)!r}",
        "[network]",
        f"images = {json.dumps(plan.learn.images)}",
        f'goal = "{plan.learn.goal}"',
    ]
    path = plan.out / "trainer.toml"
    write_whole(path, "\n".join(lines) + "\n", raises=RunError)
    return path


def decay_share() -> float:
    """The last share of a trainer's budget, over which its learning rate falls."""
    return best_recipe().optimizer.decay_share


def begin_decay(folder: Path) -> None:
    """Have the trainer's learning rate fall from now on; it ends after that."""
    write_whole(folder / DECAY_FILE, "", raises=RunError)


def forget_decay(folder: Path) -> None:
    """Take back what `begin_decay` asked of an earlier trainer."""
    (folder / DECAY_FILE).unlink(missing_ok=True)
