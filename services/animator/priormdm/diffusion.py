"""The diffusion process: noise schedule and sampling with given features.

The model predicts the clean motion. Features that a mask marks are known: they get no noise, and replace the model's
prediction at every step (imputation), so that the result has them exactly.

Sources: Nichol & Dhariwal, Improved Denoising Diffusion Probabilistic Models, 2021 (cosine schedule, respacing);
Song et al., Denoising Diffusion Implicit Models, 2021; Shafir et al., 2024 (noise that spares known features).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array

BETA_MAX = 0.999
_OFFSET = 0.008

Predict = Callable[[Float32Array, int], Float32Array]
"""Noisy features (T, 263) and a trained step -> clean features (T, 263)."""


@dataclass(frozen=True, kw_only=True)
class DiffusionSchedule:
    """Coefficients of the steps that are taken, step 0 is the last one."""

    step: tuple[int, ...]
    """The trained step that stands for each."""
    alpha_bar: tuple[float, ...]
    """Share of the signal's power that is left."""
    sigma_small: bool

    def before(self, i: int) -> float:
        """Share of the signal one step nearer to the clean motion."""
        return self.alpha_bar[i - 1] if i > 0 else 1.0

    def posterior(self, i: int) -> tuple[float, float, float]:
        """Weights of the clean and the noisy motion in the mean of the next one, and its standard deviation."""
        now, before = self.alpha_bar[i], self.before(i)
        beta = 1.0 - now / before
        clean = beta * math.sqrt(before) / (1.0 - now)
        noisy = (1.0 - before) * math.sqrt(1.0 - beta) / (1.0 - now)
        variance = beta * (1.0 - before) / (1.0 - now) if self.sigma_small else beta
        return clean, noisy, math.sqrt(variance)

    def ddim(self, i: int) -> tuple[float, float]:
        """Weights of the clean and the noisy motion in the next one, for the deterministic (DDIM) step."""
        now, before = self.alpha_bar[i], self.before(i)
        noisy = math.sqrt((1.0 - before) / (1.0 - now))
        return math.sqrt(before) - noisy * math.sqrt(now), noisy


def cosine_schedule(trained_steps: int, steps: int = 0, *, sigma_small: bool = True) -> DiffusionSchedule:
    """The cosine schedule, or evenly spread steps of it.

    Args:
        trained_steps: Steps in the model's training.
        steps: Steps to take, the first and the last trained one among them; 0 takes all.
        sigma_small: See `TrainedModel`.
    """
    if not 0 <= steps <= trained_steps:
        raise ValueError(f"steps must be within 0..{trained_steps}, the steps of the training; got {steps}.")

    def signal(t: float) -> float:
        return math.cos((t + _OFFSET) / (1.0 + _OFFSET) * math.pi / 2.0) ** 2

    alpha_bar, product = [], 1.0
    for i in range(trained_steps):
        product *= 1.0 - min(1.0 - signal((i + 1) / trained_steps) / signal(i / trained_steps), BETA_MAX)
        alpha_bar.append(product)
    count = steps or trained_steps
    chosen = [trained_steps - 1] if count == 1 else [round(k * (trained_steps - 1) / (count - 1)) for k in range(count)]
    return DiffusionSchedule(step=tuple(chosen), alpha_bar=tuple(alpha_bar[k] for k in chosen), sigma_small=sigma_small)


def sample(
    predict: Predict,
    known: Float64Array,
    is_known: BoolArray,
    schedule: DiffusionSchedule,
    rng: np.random.Generator,
    *,
    sampler: Literal["ddpm", "ddim"] = "ddpm",
) -> Float32Array:
    """Draw a motion.

    Args:
        predict: The model.
        known: Normalised features, read where they are known, shape (T, 263).
        is_known: Where they are, shape (T, 263).
        schedule: Steps to take.
        rng: Source of all noise.
        sampler: "ddpm" adds noise at every step, "ddim" only before the first.

    Returns:
        Normalised features, shape (T, 263); known ones as they were given (float32).
    """
    given = np.where(is_known, known, 0.0).astype(np.float32)
    free = (~is_known).astype(np.float32)
    count = len(schedule.step)
    start = schedule.alpha_bar[-1]
    x = np.float32(math.sqrt(start)) * given + np.float32(math.sqrt(1.0 - start)) * _noise(rng, free)
    for i in reversed(range(count)):
        clean = np.where(is_known, given, predict(x, schedule.step[i]))
        if i == 0:
            break
        if sampler == "ddim":
            a, b = schedule.ddim(i)
            x = np.float32(a) * clean + np.float32(b) * x
        else:
            a, b, sigma = schedule.posterior(i)
            x = np.float32(a) * clean + np.float32(b) * x + np.float32(sigma) * _noise(rng, free)
    return clean


def _noise(rng: np.random.Generator, free: Float32Array) -> Float32Array:
    noise: Float32Array = rng.standard_normal(free.shape).astype(np.float32) * free
    return noise
