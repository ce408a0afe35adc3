"""What a training run leaves behind: the exported policy, its metrics and the loss curve."""

import copy
import dataclasses
import platform
import shutil
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch

from readygo.common.config import section_to_mapping
from readygo.common.documents import write_json
from readygo.common.drawing.charts import line_chart, write_chart
from readygo.common.errors import PolicyError
from readygo.common.policy.artifact import METRICS_FILE
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.history import loss_curves
from readygo.services.trainer.model import PolicyNet, parameter_count
from readygo.services.trainer.run import CANDIDATE_FOLDER, TrainRun, held_out_samples
from readygo.services.trainer.validation import error_metrics, predict

CURVE_FILE = "loss.svg"
FINAL_SAMPLES = 20_000
"""Most held-out samples that the reported metrics are computed on."""


def write_outcome(run: TrainRun) -> dict[str, Any]:
    """Export the chosen weights, draw the loss curve and write `metrics.json`, whose contents are returned."""
    export_chosen(run, run.out)
    if chart := loss_chart(run.history):
        write_chart(run.out / CURVE_FILE, chart)
    shutil.rmtree(run.out / CANDIDATE_FOLDER, ignore_errors=True)
    metrics = _metrics(run)
    write_json(run.out / METRICS_FILE, metrics, raises=PolicyError)
    return metrics


def loss_chart(history: Sequence[Mapping[str, Any]]) -> str:
    """What training minimises, and the squared error on held-out episodes, from the records of the training loop."""
    return line_chart(
        loss_curves(history), x_name="samples learned from", what="Loss, and squared error on held-out episodes"
    )


def export_chosen(run: TrainRun, folder: Path) -> None:
    """Write the policy of the chosen weights."""
    export_policy(chosen_model(run), dataclasses.replace(run.spec, training=_provenance(run)), folder)


def chosen_model(run: TrainRun) -> PolicyNet:
    """A network with the chosen weights."""
    model = copy.deepcopy(run.learner.average)
    model.load_state_dict(run.chosen_weights())
    return model


def _metrics(run: TrainRun) -> dict[str, Any]:
    part, training = run.held_out, run.training.table
    return _errors(run) | {
        "parameters": parameter_count(run.learner.model),
        "training_episodes": len(run.training.reservoir.episodes),
        "validation_episodes": len(part.reservoir.episodes),
        "training_samples": len(training),
        "samples_seen": run.samples_seen,
        "samples_per_s": run.samples_seen / max(run.elapsed_s, 1e-9),
        "elapsed_s": run.elapsed_s,
        "steps": run.steps,
        "chosen_step": run.chosen_step,
        "history": run.history,
    }


def _errors(run: TrainRun) -> dict[str, float | int]:
    """Errors on what is held out, if anything is."""
    part = run.held_out
    if not part.reservoir.episodes:
        return {}
    rows = held_out_samples(part.table, FINAL_SAMPLES, run.config, run.spec.frame_spacing_steps)
    predictions = predict(chosen_model(run), run.learner.objective, part, rows)
    training = run.training.table
    mean_action = training.targets[training.usable_samples].mean(axis=0, dtype=np.float64).astype(np.float32)
    return error_metrics(predictions, part.table, rows, mean_action)


def _provenance(run: TrainRun) -> dict[str, Any]:
    return {
        "data": run.data,
        "episodes": len(run.training.reservoir.episodes),
        "chosen_step": run.chosen_step,
        "samples_seen": run.samples_seen,
        "readygo": _version("readygo"),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
        # Where perception lay says nothing elsewhere; `data` has the hash of its weights.
        "config": section_to_mapping(dataclasses.replace(run.config, perception="")),
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"
