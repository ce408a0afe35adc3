"""Errors of trained policies on the same recorded episodes, that none of them has seen.

    python -m experiments.policy.held_out DATA POLICY [POLICY ...]

Each POLICY is a folder with `checkpoint.pt` of the recipe `best`. Prints one line of JSON for each: root mean square
errors of v [m/s] and w [rad/s] of the averaged weights, and their squared error in units of the limits.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.dataset import Dataset
from readygo.common.errors import PolicyError
from readygo.services.trainer import best_recipe
from readygo.services.trainer.checkpoint import load_checkpoint
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.episodes import read_episodes, robot_of_source
from readygo.services.trainer.learner import Learner
from readygo.services.trainer.outcome import FINAL_SAMPLES
from readygo.services.trainer.parts import EpisodePart
from readygo.services.trainer.ranks import Ranks
from readygo.services.trainer.samples import spread_samples
from readygo.services.trainer.train import training_threads
from readygo.services.trainer.validation import error_metrics, predict, validation_loss


def errors(source: Dataset, policies: Sequence[Path], config: TrainConfig) -> list[dict[str, Any]]:
    """Errors of each policy on the same samples.

    Raises:
        PolicyError: If a folder has no checkpoint.
    """
    robot = robot_of_source(source)
    part, learner = EpisodePart(robot, config, 1.0), Learner(robot, config, Ranks())
    for episode in read_episodes(source, with_humans=False):
        part.reservoir.add(episode)
    rows = spread_samples(part.table, FINAL_SAMPLES)
    found = []
    for folder in policies:
        state = load_checkpoint(folder, {})
        if state is None:
            raise PolicyError(f"{folder} holds no checkpoint.pt; give a folder that readygo learn or train wrote.")
        learner.restore(state)
        predictions = predict(learner.average, learner.objective, part, rows)
        metrics = error_metrics(predictions, part.table, rows, np.zeros(2, np.float32))
        loss = validation_loss(predictions, part.table.targets[rows], part.table.limits(rows))
        kept = {name: metrics[name] for name in ("rmse_v_mps", "rmse_w_radps", "validation_samples")}
        found.append({"policy": str(folder), "samples_seen": state["counters"][1], "loss": loss} | kept)
    return found


def main() -> None:
    """Print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("policies", type=Path, nargs="+", metavar="POLICY")
    arguments = parser.parse_args()
    with training_threads(best_recipe()):
        for row in errors(Dataset([arguments.data]), arguments.policies, best_recipe()):
            print(json.dumps(row))


if __name__ == "__main__":
    main()
