"""The state of a training run: steps, validation, the best weights so far, and how it is saved."""

import copy
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from readygo.common.config import section_to_mapping
from readygo.common.policy import PolicySpec
from readygo.common.robot.kinematics import whole_steps
from readygo.services.trainer.augment import (
    TurnedCamera,
    correct_for_turn,
    corrupt_previous,
    draw_yaws,
    hindsight_goals,
    shift_frames,
    vary_light,
)
from readygo.services.trainer.checkpoint import load_checkpoint, save_checkpoint
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet, images_from_bytes
from readygo.services.trainer.parts import build_parts, robot_of_source
from readygo.services.trainer.samples import Batch, Indices, SampleSource, epoch_samples, make_batch, spread_samples
from readygo.services.trainer.validation import predict, validation_loss

WARM_UP_STEPS = 50
FINAL_RATE = 0.01
"""Where the cosine ends, as a share of the learning rate."""
BUDGET_FIELDS = ("minutes", "epochs", "threads", "cache_mb")
"""Settings that may change when a run is continued."""
CANDIDATE_FOLDER = "candidate"
"""Policy whose closed-loop success is being measured."""

Evaluate = Callable[[Path], float]
"""Closed-loop success rate of the policy in a folder."""


@dataclass(frozen=True, kw_only=True)
class TrainProgress:
    """How far training is, after each step."""

    fraction: float
    step: int
    epoch: int
    train_loss: float
    validation_loss: float


def learning_rate(config: TrainConfig, step: int, fraction: float) -> float:
    """Learning rate of a step, after the given fraction of the budget."""
    warm_up = min(1.0, (step + 1) / WARM_UP_STEPS)
    if config.schedule == "constant":
        return config.learning_rate * warm_up
    cosine = 0.5 * (1 + math.cos(math.pi * min(fraction, 1.0)))
    return config.learning_rate * warm_up * (FINAL_RATE + (1 - FINAL_RATE) * cosine)


class TrainRun:
    """State of one training run."""

    def __init__(
        self,
        source: SampleSource,
        config: TrainConfig,
        out: Path,
        *,
        validation: SampleSource | None,
        evaluate: Evaluate | None,
    ) -> None:
        self.config, self.out, self.evaluate = config, out, evaluate
        self.robot = robot_of_source(source)
        self.spec = PolicySpec(robot=self.robot, sensor=source.sensor, frame_spacing_s=config.frame_spacing_s)
        self._latency_steps = whole_steps(self.robot.camera.latency_s)
        self._turned = TurnedCamera(self.robot.camera)
        self.train_part, self.held_out = build_parts(source, validation, config)
        self.validation_rows = spread_samples(self.held_out.episodes, config.validation_samples)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.model = PolicyNet(self.robot)
        self.model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = copy.deepcopy(self.model).requires_grad_(False)
        self.optimizer = torch.optim.AdamW(
            self.model.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        self.step, self.epoch, self.epoch_step, self.samples_seen = 0, 0, 0, 0
        self.epoch_length = 1
        """Batches of an epoch, known once it has begun."""
        self.elapsed_s = 0.0
        self.history: list[dict[str, float]] = []
        self.best: dict[str, Any] = {}
        self._losses: list[float] = []
        out.mkdir(parents=True, exist_ok=True)
        self._restore()

    def go(self, report: Callable[[TrainProgress], None]) -> None:
        """Train until the budget is spent."""
        while self.fraction() < 1.0:
            batches = self._epoch_batches()
            self.epoch_length = len(batches)
            while self.epoch_step < len(batches) and self.fraction() < 1.0:
                self._timed_step(batches[self.epoch_step])
                if self.step % self.config.validate_every_steps == 0:
                    self._validate()
                report(self._progress())
            if self.epoch_step >= len(batches):
                self.epoch, self.epoch_step = self.epoch + 1, 0
        if not self.best or self.history[-1]["step"] != self.step:
            self._validate(last=True)

    def fraction(self) -> float:
        """Share of the budget that is spent."""
        if self.config.epochs is not None:
            return (self.epoch + self.epoch_step / self.epoch_length) / self.config.epochs
        return self.elapsed_s / (60 * self.config.minutes)

    def _epoch_batches(self) -> list[Indices]:
        return epoch_samples(
            self.train_part.episodes,
            spacing_steps=self.spec.frame_spacing_steps,
            chain_length=self.config.chain_length,
            batch_size=self.config.batch_size,
            rng=np.random.default_rng([self.config.seed, self.epoch]),
        )

    def _timed_step(self, samples: Indices) -> None:
        begin_s = time.monotonic()
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.config, self.step, self.fraction())
        batch = make_batch(samples, self.train_part.table.first, self.spec.frame_spacing_steps, self._latency_steps)
        self._losses.append(self._optimise(batch))
        self.step, self.epoch_step = self.step + 1, self.epoch_step + 1
        self.samples_seen += len(samples)
        self.elapsed_s += time.monotonic() - begin_s

    def _optimise(self, batch: Batch) -> float:
        part, config = self.train_part, self.config
        rng = np.random.default_rng([config.seed, self.epoch, self.epoch_step])
        self.model.train()
        first = part.table.first
        yaws_rad = draw_yaws(first[batch.frames], config.yaw_error_rad, rng)
        frames = part.frames.get(batch.frames)
        if config.yaw_error_rad > 0:
            frames = self._turned.turn(frames, yaws_rad)
        frames = shift_frames(frames, first[batch.frames], config.shift_px, rng)
        images = images_from_bytes(torch.from_numpy(frames))
        vary_light(images, first[batch.frames], config.photometric, rng)
        previous = torch.from_numpy(part.table.previous[batch.samples])
        actions, goals = correct_for_turn(
            torch.from_numpy(part.table.actions[batch.samples]),
            torch.from_numpy(hindsight_goals(part.table, batch.samples, config.hindsight, rng)),
            torch.from_numpy(yaws_rad[batch.window[:, -1]].astype(np.float32)),
            config.yaw_gain_per_s,
            self.robot.w_max_radps,
        )
        if rng.random() < config.mirror:
            images, left = images.flip(3), torch.tensor([1.0, -1.0])
            previous, goals, actions = previous * left, goals * left, actions * left
        previous = self.model.normalise_previous(previous)
        previous = corrupt_previous(previous, config.previous_noise, config.previous_dropout, rng)
        actions = actions / self.model.limits
        loss = nn.functional.mse_loss(self.model(images, torch.from_numpy(batch.window), previous, goals), actions)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        self._update_average()
        return loss.item()

    @torch.no_grad()
    def _update_average(self) -> None:
        decay = min(self.config.ema_decay, (1 + self.step) / (10 + self.step))
        latest = self.model.state_dict()
        for name, value in self.average.state_dict().items():
            if value.is_floating_point():
                value.lerp_(latest[name], 1 - decay)

    def _validate(self, *, last: bool = False) -> None:
        begin_s = time.monotonic()
        part = self.held_out
        predictions = predict(self.average, part.frames, part.table, self.validation_rows, self.spec)
        loss = validation_loss(predictions, part.table.actions[self.validation_rows], self.model.limits.numpy())
        train_loss = float(np.mean(self._losses)) if self._losses else math.nan
        self._losses.clear()
        self.elapsed_s += time.monotonic() - begin_s
        self.history.append(
            {
                "step": self.step,
                "samples": self.samples_seen,
                "elapsed_s": round(self.elapsed_s, 3),
                "train_loss": train_loss,
                "validation_loss": loss,
            }
        )
        self._choose(loss, last)
        self._save()

    def _choose(self, loss: float, last: bool) -> None:
        """Keep the averaged weights if they are the best so far: by success rate where it is known, then by loss."""
        score = (0.0, -loss)
        if self.evaluate is not None:
            if not last and len(self.history) % self.config.rollout_every != 0:
                return
            export_policy(self.average, self.spec, self.out / CANDIDATE_FOLDER)
            self.history[-1]["success_rate"] = self.evaluate(self.out / CANDIDATE_FOLDER)
            score = (self.history[-1]["success_rate"], -loss)
        if not self.best or score > tuple(self.best["score"]):
            model = {name: value.clone() for name, value in self.average.state_dict().items()}
            self.best = {"score": list(score), "step": self.step, "model": model}

    def _identity(self) -> dict[str, Any]:
        settings = {k: v for k, v in section_to_mapping(self.config).items() if k not in BUDGET_FIELDS}
        return {
            "training data": self.train_part.source.content_hash,
            "validation data": self.held_out.source.content_hash,
            "robot": section_to_mapping(self.robot),
        } | settings

    def _save(self) -> None:
        save_checkpoint(
            {
                "identity": self._identity(),
                "model": self.model.state_dict(),
                "average": self.average.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "counters": [self.step, self.epoch, self.epoch_step, self.epoch_length, self.samples_seen],
                "elapsed_s": self.elapsed_s,
                "history": self.history,
                "best": self.best,
            },
            self.out,
        )

    def _restore(self) -> None:
        state = load_checkpoint(self.out, self._identity())
        if state is None:
            return
        self.model.load_state_dict(state["model"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step, self.epoch, self.epoch_step, self.epoch_length, self.samples_seen = state["counters"]
        self.elapsed_s, self.history, self.best = state["elapsed_s"], state["history"], state["best"]

    def _progress(self) -> TrainProgress:
        latest = self.history[-1]["validation_loss"] if self.history else math.nan
        return TrainProgress(
            fraction=min(1.0, self.fraction()),
            step=self.step,
            epoch=self.epoch,
            train_loss=self._losses[-1] if self._losses else math.nan,
            validation_loss=latest,
        )
