"""Errors of a policy on held-out episodes, open loop."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from readygo.common.policy import PolicySpec
from readygo.common.robot.kinematics import whole_steps
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.model import PolicyNet, images_from_bytes
from readygo.services.trainer.samples import Batch, Indices, SampleTable, make_batch

VALIDATION_BATCH = 128


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Clipped predictions for held-out samples."""

    with_previous: npt.NDArray[np.float32]
    """v [m/s], w [rad/s] given the recorded previous action, shape (B, 2)."""
    without_previous: npt.NDArray[np.float32]
    """The same with the previous action withheld: what images and goal alone tell, shape (B, 2)."""


def predict(
    model: PolicyNet, frames: FrameCache, table: SampleTable, samples: Indices, spec: PolicySpec
) -> Predictions:
    """Predictions of `model` for `samples`, in evaluation mode."""
    latency_steps = whole_steps(spec.robot.camera.latency_s)
    model.eval()
    given, withheld = [], []
    with torch.inference_mode():
        for begin in range(0, len(samples), VALIDATION_BATCH):
            rows = samples[begin : begin + VALIDATION_BATCH]
            batch = make_batch(rows, table.first, spec.frame_spacing_steps, latency_steps)
            pair = _predict_batch(model, frames, table, batch)
            given.append(pair[0])
            withheld.append(pair[1])
    return Predictions(with_previous=np.concatenate(given), without_previous=np.concatenate(withheld))


def _predict_batch(
    model: PolicyNet, frames: FrameCache, table: SampleTable, batch: Batch
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    images = images_from_bytes(torch.from_numpy(frames.get(batch.frames)))
    window = torch.from_numpy(batch.window)
    goals = torch.from_numpy(table.goals_xy_m[batch.samples])
    previous = model.normalise_previous(torch.from_numpy(table.previous[batch.samples]))
    latents = model.encode_windows(images, window)
    given = model.clip(model.act(latents, previous, goals))
    withheld = model.clip(model.act(latents, torch.zeros_like(previous), goals))
    return given.numpy(), withheld.numpy()


def validation_loss(
    predictions: Predictions, actions: npt.NDArray[np.float32], limits: npt.NDArray[np.float32]
) -> float:
    """Mean squared error in units of the limits, the previous action withheld.

    Given the previous action, a policy that copies it has the smallest error on recorded data, and the checkpoint would
    be chosen for copying; what images and goal teach shows without it.
    """
    return float(np.mean(((predictions.without_previous - actions) / limits).astype(np.float64) ** 2))


def error_metrics(
    predictions: Predictions, table: SampleTable, samples: Indices, mean_action: npt.NDArray[np.float32]
) -> dict[str, float | int]:
    """Root mean square errors on held-out samples, beside two trivial predictors.

    Args:
        predictions: Predictions for `samples`.
        table: Arrays of the source.
        samples: Held-out samples.
        mean_action: Mean action of the training episodes [m/s, rad/s], shape (2,).

    Returns:
        RMSE of v and w: of the policy, of the policy without previous action, of predicting `mean_action`, of copying
        the previous action, and the ratios policy / mean.
    """
    actions = table.actions[samples]
    rmse = {
        "": _rmse(predictions.with_previous - actions),
        "without_previous_": _rmse(predictions.without_previous - actions),
        "mean_baseline_": _rmse(mean_action - actions),
        "copy_baseline_": _rmse(table.previous[samples] - actions),
    }
    metrics: dict[str, float | int] = {}
    for name, (v, w) in rmse.items():
        metrics |= {f"{name}rmse_v_mps": v, f"{name}rmse_w_radps": w}
    for name in ("", "without_previous_"):
        for axis, unit in ((0, "v"), (1, "w")):
            baseline = rmse["mean_baseline_"][axis]
            metrics[f"{name}ratio_{unit}"] = rmse[name][axis] / baseline if baseline > 0 else 0.0
    return metrics | {"validation_samples": len(samples)}


def _rmse(errors: npt.NDArray[np.float32]) -> tuple[float, float]:
    v, w = np.sqrt(np.mean(errors.astype(np.float64) ** 2, axis=0))
    return float(v), float(w)
