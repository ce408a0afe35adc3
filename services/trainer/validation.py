"""Errors of a policy on held-out episodes, open loop."""

from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Int64Array
from readygo.services.trainer.inputs import MotionInput
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective
from readygo.services.trainer.parts import EpisodePart
from readygo.services.trainer.samples import TrainingSamples

VALIDATION_BATCH = 128


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Clipped predictions for held-out samples."""

    given: Float32Array
    """v [m/s], w [rad/s] as in closed loop, shape (B, 2)."""
    withheld: Float32Array
    """The policy's commands with the previous action withheld, where the policy takes it at all, shape (B, 2)."""


def predict(model: PolicyNet, objective: Objective, part: EpisodePart, samples: Int64Array) -> Predictions:
    """Predictions of `model` for `samples` of a part, in evaluation mode."""
    given = _answers(model, objective, part, samples, withheld=False)
    if model.inputs.motion is MotionInput.POSES:
        return Predictions(given=given, withheld=given)
    return Predictions(given=given, withheld=_answers(model, objective, part, samples, withheld=True))


def _answers(
    model: PolicyNet, objective: Objective, part: EpisodePart, samples: Int64Array, *, withheld: bool
) -> Float32Array:
    model.eval()
    device, table = model.limits.device, part.table
    answers = []
    with torch.inference_mode():
        for begin in range(0, len(samples), VALIDATION_BATCH):
            batch = samples[begin : begin + VALIDATION_BATCH]
            shown = objective.plain(table, part.frames, batch, withheld=withheld).to(device)
            answers.append(model.clip(model.decide(objective.answers(model, shown)[0]), shown.traits).cpu().numpy())
    return np.concatenate(answers)


def validation_loss(predictions: Predictions, targets: Float32Array, limits: Float32Array) -> float:
    """Mean squared error in units of the robots' limits, shape (B, 2), the previous action withheld.

    Given the previous action, a policy that copies it has the smallest error on recorded data; what images and goal
    teach shows without it.
    """
    return float(np.mean(((predictions.withheld - targets) / limits).astype(np.float64) ** 2))


def error_metrics(
    predictions: Predictions, table: TrainingSamples, samples: Int64Array, mean_action: Float32Array
) -> dict[str, float | int]:
    """Root mean square errors on held-out samples, beside two trivial predictors.

    Args:
        predictions: Predictions for `samples`.
        table: The part's numbers.
        samples: Held-out samples.
        mean_action: Mean target of the training episodes [m/s, rad/s], shape (2,).

    Returns:
        RMSE of v and w: of the policy, of the policy without previous action, of predicting `mean_action`, of copying
        the previous action, and the ratios policy / mean.
    """
    targets = table.targets[samples]
    rmse = {
        "": _rmse(predictions.given - targets),
        "without_previous_": _rmse(predictions.withheld - targets),
        "mean_baseline_": _rmse(mean_action - targets),
        "copy_baseline_": _rmse(table.motion[samples, -2:] - targets),
    }
    metrics: dict[str, float | int] = {}
    for name, (v, w) in rmse.items():
        metrics |= {f"{name}rmse_v_mps": v, f"{name}rmse_w_radps": w}
    for name in ("", "without_previous_"):
        for axis, unit in ((0, "v"), (1, "w")):
            baseline = rmse["mean_baseline_"][axis]
            metrics[f"{name}ratio_{unit}"] = rmse[name][axis] / baseline if baseline > 0 else 0.0
    return metrics | {"validation_samples": len(samples)}


def _rmse(errors: Float32Array) -> tuple[float, float]:
    v, w = np.sqrt(np.mean(errors.astype(np.float64) ** 2, axis=0))
    return float(v), float(w)
