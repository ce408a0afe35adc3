"""Training from recorded samples to an exported policy."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.outcome import write_outcome
from readygo.services.trainer.run import Evaluate, TrainProgress, TrainRun
from readygo.services.trainer.samples import SampleSource


def train(
    source: SampleSource,
    config: TrainConfig,
    out: Path,
    *,
    validation: SampleSource | None = None,
    evaluate: Evaluate | None = None,
    report: Callable[[TrainProgress], None] | None = None,
) -> dict[str, Any]:
    """Train a policy, or continue where an earlier call with the same `out` stopped, and export it.

    Args:
        source: Samples to learn from.
        config: Budget and settings.
        out: Folder of the policy artifact; also holds `checkpoint.pt`, `loss.png` and `metrics.json`.
        validation: Held-out samples; None holds out whole episodes of `source`.
        evaluate: Closed-loop success rate of an exported policy; chooses the checkpoint instead of the loss.
        report: Told about every step.

    Returns:
        What `metrics.json` holds.

    Raises:
        DatasetError: If the data hold too few episodes or images of another size.
        PolicyError: If `out` belongs to a run of other data or settings.
    """
    threads_before = torch.get_num_threads()
    torch.set_num_threads(config.threads or available_cores())
    try:
        run = TrainRun(source, config, out, validation=validation, evaluate=evaluate)
        run.go(report or (lambda _: None))
        return write_outcome(run)
    finally:
        torch.set_num_threads(threads_before)


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
