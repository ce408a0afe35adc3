"""Training from recorded samples to an exported policy."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import torch

from readygo.common.cores import available_cores
from readygo.common.dataset import Dataset
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.episodes import robot_of_source
from readygo.services.trainer.outcome import write_outcome
from readygo.services.trainer.parts import build_parts
from readygo.services.trainer.run import Evaluate, TrainProgress, TrainRun


def train_policy(
    source: Dataset,
    config: TrainConfig,
    out: Path,
    *,
    validation: Dataset | None = None,
    evaluate: Evaluate | None = None,
    evaluated: str = "",
    report: Callable[[TrainProgress], None] | None = None,
) -> dict[str, Any]:
    """Train a policy, or continue where an earlier call with the same `out` stopped, and export it.

    Args:
        source: Samples to learn from.
        config: Budget and settings.
        out: Folder of the policy artifact; also holds `checkpoint.pt`, `loss.svg` and `metrics.json`.
        validation: Held-out samples; None holds out whole episodes of `source`.
        evaluate: Closed-loop success rate of an exported policy, which chooses the checkpoint; without it the last one
            is taken.
        evaluated: Names the episodes that `evaluate` drives: when a run resumes with others, weights that were chosen
            by the earlier ones are not kept.
        report: Told about every step.

    Returns:
        What `metrics.json` holds.

    Raises:
        DatasetError: If the data hold too few episodes or images of another size.
        PolicyError: If `out` belongs to a run of other data or settings, or the loss is not finite.
    """
    robot = robot_of_source(source)
    parts = build_parts(source, validation, config)
    held_out_hash = (validation or source).content_hash
    data = {"training_data": source.content_hash, "validation_data": held_out_hash}
    with training_threads(config):
        run = TrainRun(parts, robot, source.sensor, config, out, data=data, evaluate=evaluate, evaluated=evaluated)
        run.go(report or (lambda _: None))
        return write_outcome(run) if run.ranks.is_first else {}


@contextmanager
def training_threads(config: TrainConfig) -> Iterator[None]:
    """Have torch and OpenCV compute with as many threads as a run may have."""
    threads_before, opencv_before = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(config.threads or available_cores())
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads_before)
        cv2.setNumThreads(opencv_before)
