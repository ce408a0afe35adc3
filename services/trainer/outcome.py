"""What a training run leaves behind: the exported policy, its metrics and the loss curve."""

import dataclasses
import json
import platform
import shutil
from importlib import metadata
from typing import Any

import numpy as np
import torch

from readygo.common.config import section_to_mapping
from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.policy.artifact import METRICS_FILE
from readygo.services.trainer.curve import draw_history
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import parameter_count
from readygo.services.trainer.run import CANDIDATE_FOLDER, TrainRun
from readygo.services.trainer.samples import spread_samples
from readygo.services.trainer.validation import error_metrics, predict

CURVE_FILE = "loss.png"
FINAL_SAMPLES = 20_000
"""Most held-out samples that the reported metrics are computed on."""


def write_outcome(run: TrainRun) -> dict[str, Any]:
    """Export the chosen weights, draw the loss curve and write `metrics.json`, whose contents are returned."""
    run.average.load_state_dict(run.best["model"])
    export_policy(run.average, dataclasses.replace(run.spec, training=_provenance(run)), run.out)
    draw_history(run.out / CURVE_FILE, run.history)
    shutil.rmtree(run.out / CANDIDATE_FOLDER, ignore_errors=True)
    metrics = _metrics(run)
    write_whole(run.out / METRICS_FILE, json.dumps(metrics, indent=2) + "\n", raises=PolicyError)
    return metrics


def _metrics(run: TrainRun) -> dict[str, Any]:
    part = run.held_out
    rows = spread_samples(part.episodes, FINAL_SAMPLES)
    predictions = predict(run.average, part.frames, part.table, rows, run.spec)
    actions = [
        run.train_part.table.actions[item.first_sample : item.first_sample + item.sample_count]
        for item in run.train_part.episodes
    ]
    trained_on = np.concatenate(actions)
    mean_action = trained_on.mean(axis=0, dtype=np.float64).astype(np.float32)
    return error_metrics(predictions, part.table, rows, mean_action) | {
        "parameters": parameter_count(run.model),
        "training_episodes": len(run.train_part.episodes),
        "validation_episodes": len(part.episodes),
        "training_samples": len(trained_on),
        "samples_seen": run.samples_seen,
        "samples_per_s": run.samples_seen / max(run.elapsed_s, 1e-9),
        "elapsed_s": run.elapsed_s,
        "steps": run.step,
        "chosen_step": run.best["step"],
        "history": run.history,
    }


def _provenance(run: TrainRun) -> dict[str, Any]:
    return {
        "data_sha256": run.train_part.source.content_hash,
        "validation_data_sha256": run.held_out.source.content_hash,
        "episodes": len(run.train_part.episodes),
        "chosen_step": run.best["step"],
        "readygo": _version("readygo"),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
        "config": {name: value for name, value in section_to_mapping(run.config).items() if value is not None},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"
