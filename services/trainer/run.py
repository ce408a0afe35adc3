"""A training run: steps, validation, the weights that were chosen, and how all of it is kept."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from readygo.common.arrays import Int64Array
from readygo.common.camera import SensorConfig
from readygo.common.config import section_to_mapping
from readygo.common.cores import available_cores
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec
from readygo.common.robot import RobotConfig
from readygo.services.trainer.checkpoint import load_checkpoint, refuse_damaged, save_checkpoint
from readygo.services.trainer.config import CHECKPOINT_FILE, TrainConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.learner import Learner
from readygo.services.trainer.parts import EpisodePart
from readygo.services.trainer.pretrained import perception_weights
from readygo.services.trainer.ranks import Ranks
from readygo.services.trainer.samples import TrainingSamples, draw_samples, spread_chains, spread_samples
from readygo.services.trainer.schedule import RateSchedule
from readygo.services.trainer.validation import predict, validation_loss

VALIDATION_SAMPLES = 1000
"""Most held-out samples that one validation looks at, spread evenly."""
ROLLOUT_EVERY = 5
"""Validations between closed-loop rollouts, where they choose the checkpoint."""
SAVE_EVERY_S = 30.0
"""Processor time between checkpoints [s]."""
BUDGET_FIELDS = (
    "minutes",
    "samples",
    "threads",
    "memory_mb",
    "cache_mb",
    "offer_every_s",
    "perception",
)
"""Settings that may change when a run is continued; of `perception` the weights must stay, not the place."""
CANDIDATE_FOLDER = "candidate"
"""Policy whose closed-loop success is being measured."""

Evaluate = Callable[[Path], float]
"""Closed-loop success rate of the policy in a folder."""


@dataclass(frozen=True, kw_only=True)
class TrainProgress:
    """How far training is, after each step."""

    fraction: float
    step: int
    train_loss: float
    validation_loss: float


class TrainRun:
    """State of one training run; `step` is all that moves it on."""

    def __init__(
        self,
        parts: tuple[EpisodePart, EpisodePart],
        robot: RobotConfig,
        sensor: SensorConfig,
        config: TrainConfig,
        out: Path,
        *,
        data: dict[str, str],
        evaluate: Evaluate | None = None,
        evaluated: str = "",
    ) -> None:
        """Begin, or resume from the checkpoint in `out`.

        Args:
            parts: What is trained on and what is held out; episodes may come and go.
            robot: Whose camera took the images.
            sensor: What varied of that camera.
            config: Budget and settings.
            out: Folder of the run.
            data: Names and hashes of data that must be the same when the run resumes.
            evaluate: Chooses the weights by closed-loop success; without it the last ones are taken.
            evaluated: Names the episodes that `evaluate` drives: success rates in others are not compared.

        Raises:
            PolicyError: If `out` belongs to a run of other data or settings, or perception is missing or does not fit.
        """
        self.training, self.held_out = parts
        encoder = encoder_of(robot, config)
        data = data | ({"perception_weights": encoder[1]} if encoder else {})
        self.config, self.out, self.data, self.evaluate = config, out, data, evaluate
        self._evaluated = evaluated
        self.spec = PolicySpec(robot=robot, sensor=sensor, frame_spacing_s=config.sampling.frame_spacing_s)
        self.ranks = Ranks()
        self.learner = Learner(robot, config, self.ranks, encoder[0] if encoder else None)
        self.schedule = RateSchedule(config.optimizer)
        self.steps, self.samples_seen, self.elapsed_s = 0, 0, 0.0
        """`elapsed_s` is processor time of each thread, on a GPU the time that went by [s]."""
        self.history: list[dict[str, float]] = []
        self.best: dict[str, Any] = {}
        """The weights of the highest success rate, with it and their step; empty before there is one."""
        self._identity = {**data, "robot": section_to_mapping(robot)} | _flat(section_to_mapping(config))
        self._losses: list[float] = []
        self._fraction, self._saved_s = 0.0, 0.0
        out.mkdir(parents=True, exist_ok=True)
        self._restore()
        self._fraction = self._share_spent()

    @property
    def fraction(self) -> float:
        """Share of the budget that is spent."""
        return self._fraction

    @property
    def is_over(self) -> bool:
        """True if nothing is left to do."""
        return self._fraction >= self.schedule.end

    def go(self, report: Callable[[TrainProgress], None]) -> None:
        """Train until the budget is spent."""
        while not self.is_over:
            self.step()
            report(self.progress())
        self.finish()

    def step(self) -> None:
        """One step of the optimizer, and a validation and a checkpoint where they are due.

        Raises:
            PolicyError: If the loss is not finite; the last checkpoint is left as it is.
        """
        validations = self.samples_seen // self.config.validate_every
        with self._clock():
            samples = self._draw()
            self._learn(samples)
            self.steps, self.samples_seen = self.steps + 1, self.samples_seen + len(samples) * self.ranks.count
        if self.samples_seen // self.config.validate_every > validations:
            self.validate()
        self._fraction = self.ranks.broadcast(self._share_spent())
        if self.elapsed_s - self._saved_s >= SAVE_EVERY_S:
            self.save()

    def finish(self) -> None:
        """Validate what the last steps made, in closed loop too where that chooses, and keep it."""
        if not self.history or self.history[-1]["step"] != self.steps:
            self.validate(last=True)
        elif self.evaluate and self.ranks.is_first and not (self.best and "success_rate" in self.history[-1]):
            self._roll_out(self.evaluate)
        self.save()

    def validate(self, *, last: bool = False) -> None:
        """Measure the averaged weights on what is held out, and in closed loop where that is due."""
        if not self.ranks.is_first:
            return
        entry = {"step": self.steps, "samples": self.samples_seen, "elapsed_s": round(self.elapsed_s, 3)}
        entry["train_loss"] = float(np.mean(self._losses)) if self._losses else math.nan
        self._losses.clear()
        with self._clock():
            entry["validation_loss"] = self.validation_loss()
        self.history.append(entry)
        if self.evaluate is not None and (last or len(self.history) % ROLLOUT_EVERY == 0):
            self._roll_out(self.evaluate)

    def validation_loss(self) -> float:
        """Error of the averaged weights on held-out samples; not a number if there are none."""
        if not self.held_out.reservoir.episodes:
            return math.nan
        table = self.held_out.table
        rows = held_out_samples(table, VALIDATION_SAMPLES, self.config, self.spec.frame_spacing_steps)
        predictions = predict(self.learner.average, self.learner.objective, self.held_out, rows)
        return validation_loss(predictions, table.targets[rows], table.limits(rows))

    def chosen_weights(self) -> dict[str, Any]:
        """The weights of the highest measured success rate; the averaged ones of now if none was measured."""
        weights: dict[str, Any] = self.best["model"] if self.best else self.learner.average.state_dict()
        return weights

    @property
    def chosen_step(self) -> int:
        """The step of `chosen_weights`."""
        return int(self.best["step"]) if self.best else self.steps

    def save(self) -> None:
        """Write the checkpoint.

        Raises:
            PolicyError: If the weights are not finite, or the disk is full; the checkpoint before is left then.
        """
        if not self.ranks.is_first:
            return
        if not self.learner.is_finite:
            raise PolicyError(f"The weights are not finite after step {self.steps}; {self._remedy()}.")
        state = {
            "identity": self._identity,
            "counters": [self.steps, self.samples_seen],
            "elapsed_s": self.elapsed_s,
            "budget": self._budget,
            "decay_from": self.schedule.decay_from,
            "evaluated": self._evaluated,
            "history": self.history,
            "losses": self._losses,
            "best": self.best,
        }
        save_checkpoint(state | self.learner.state(), self.out)
        self._saved_s = self.elapsed_s

    def progress(self) -> TrainProgress:
        """How far training is."""
        return TrainProgress(
            fraction=min(1.0, self._fraction / self.schedule.end),
            step=self.steps,
            train_loss=self._losses[-1] if self._losses else math.nan,
            validation_loss=self.history[-1]["validation_loss"] if self.history else math.nan,
        )

    @property
    def _budget(self) -> tuple[str, float]:
        """Unit and amount of the budget."""
        config = self.config
        return ("minutes", config.minutes) if config.samples is None else ("samples", config.samples)

    def _share_spent(self) -> float:
        return self._share_of(*self._budget)

    def _share_of(self, unit: str, amount: float) -> float:
        """Share of a budget that is spent."""
        return self.samples_seen / amount if unit == "samples" else self.elapsed_s / (60 * amount)

    def _draw(self) -> Int64Array:
        sampling = self.config.sampling
        return draw_samples(
            self.training.table,
            batch_size=sampling.batch_size,
            chain_length=sampling.chain_length,
            spacing_steps=self.spec.frame_spacing_steps,
            rng=self._rng(0),
        )

    def _learn(self, samples: Int64Array) -> None:
        table = self.training.table
        shown = self.learner.objective.training(table, self.training.frames, samples, self._rng(1))
        loss = self.learner.learn(shown, self.schedule.rate(self.steps, self._fraction), self.steps)
        if not math.isfinite(loss):
            names = sorted({table.names[row] for row in table.episode[samples].tolist()})
            raise PolicyError(
                f"The loss of step {self.steps} is {loss} on episodes {', '.join(name[:16] for name in names)}; "
                f"{self._remedy()}."
            )
        self._losses.append(loss)

    def _rng(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.config.seed, self.steps, self.ranks.rank, purpose])

    def _remedy(self) -> str:
        saved = (self.out / CHECKPOINT_FILE).exists()
        kept = f"the checkpoint in {self.out} is from before that" if saved else "there is no earlier checkpoint"
        return f"{kept}; continue with a lower --optimizer.learning-rate in another --out"

    def _roll_out(self, evaluate: Evaluate) -> None:
        export_policy(self.learner.average, self.spec, self.out / CANDIDATE_FOLDER)
        rate = evaluate(self.out / CANDIDATE_FOLDER)
        self.history[-1]["success_rate"] = rate
        if not self.best or rate >= self.best["success_rate"]:
            model = {name: value.clone() for name, value in self.learner.average.state_dict().items()}
            self.best = {"success_rate": rate, "step": self.steps, "model": model}

    def _restore(self) -> None:
        state = load_checkpoint(self.out, self._identity)
        if state is None:
            return
        with refuse_damaged(self.out / CHECKPOINT_FILE):
            self.learner.restore(state)
            self.steps, self.samples_seen = state["counters"]
            self.elapsed_s = self._saved_s = state["elapsed_s"]
            self.schedule.decay_from = state["decay_from"]
            # Checkpoints of earlier versions name neither budget nor episodes.
            if (budget := state.get("budget", self._budget)) != self._budget:
                self.schedule.rescale(self._share_of(*budget), self._share_spent())
            self.history, self._losses, self.best = state["history"], state["losses"], state["best"]
            if state.get("evaluated", self._evaluated) != self._evaluated:
                self.best = {}

    def _clock(self) -> "BudgetClock":
        return BudgetClock(self)


def held_out_samples(table: TrainingSamples, limit: int, config: TrainConfig, spacing_steps: int) -> Int64Array:
    """At most `limit` samples that errors are measured on: in chains, for a network that remembers."""
    if not config.network.memory_count:
        return spread_samples(table, limit)
    return spread_chains(table, limit, chain_length=config.sampling.chain_length, spacing_steps=spacing_steps)


def encoder_of(robot: RobotConfig, config: TrainConfig) -> tuple[dict[str, Tensor], str] | None:
    """Weights that a pretrained encoder begins with, and their SHA-256; None for one that learns with the policy.

    Raises:
        PolicyError: If one is given and the other is not, or they do not fit.
    """
    if config.network.encoder == "own":
        if config.perception:
            raise PolicyError("--perception goes with --recipe pretrained.")
        return None
    if not config.perception:
        raise PolicyError(
            "--recipe pretrained needs trained perception: give its folder with --perception "
            "(readygo train DATA --recipe perception --out FOLDER)."
        )
    return perception_weights(Path(config.perception), robot, config)


class BudgetClock:
    """Counts the time of a block as a run's: processor time of each thread; on a GPU the time that went by."""

    def __init__(self, run: TrainRun) -> None:
        self._run, self._begin_s = run, 0.0
        self._on_gpu = run.learner.device.type == "cuda"

    def __enter__(self) -> None:
        self._begin_s = self._now_s()

    def __exit__(self, *_: object) -> None:
        threads = 1 if self._on_gpu else self._run.config.threads or available_cores()
        self._run.elapsed_s += (self._now_s() - self._begin_s) / threads

    def _now_s(self) -> float:
        return time.perf_counter() if self._on_gpu else time.process_time()


def _flat(mapping: dict[str, Any]) -> dict[str, Any]:
    """Settings by their own names; those that may change when a run resumes are left out."""
    flat: dict[str, Any] = {}
    for name, value in mapping.items():
        flat |= value if isinstance(value, dict) else {name: value}
    return {name: value for name, value in flat.items() if name not in BUDGET_FIELDS}
