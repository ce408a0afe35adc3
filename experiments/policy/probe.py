"""What a network reads from the images of recorded episodes, on episodes that it was not trained on.

    python -m experiments.policy.probe DATA... --minutes 2 --set fusion=early --set latent_count=128

Trains the recipe `best` with other settings, for some processor time of one thread, on data of the line that drives:
the expert was asked, and the risks of commands are named. Prints one row of JSON; `--out FILE` appends it to a list.

- human_presence: is a human visible within 6 m? AUC against the samples in which none is; the same for those within
  2 m, from 2 to 4 m and from 4 to 6 m. Errors of bearing and distance where one is.
- human_risk, obstacle_risk: would this command meet one? AUC over all commands of all states, and the mean over states
  of the AUC among the commands of one state: the first needs to know whether there is danger, the second only which
  commands are dangerous. "blind" is what a fixed ranking reaches: how often each command met one in training.
- cross_entropy: of the expert's command.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from readygo.benchmarks.rasterizer.render import machine
from readygo.common.arrays import BoolArray, FloatingArray, Int64Array
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, DatasetError, ReadygoError
from readygo.common.robot.command_grid import COMMAND_COUNT, HUMAN, OBSTACLE, UNKNOWN_RISK
from readygo.runs.training import make_config
from readygo.services.trainer import TrainConfig
from readygo.services.trainer.episodes import robot_of_source
from readygo.services.trainer.parts import build_parts
from readygo.services.trainer.run import TrainRun
from readygo.services.trainer.samples import spread_samples
from readygo.services.trainer.train import training_threads
from readygo.services.trainer.validation import VALIDATION_BATCH

BINS_M = ((0.0, 2.0), (2.0, 4.0), (4.0, 6.0))
"""Distances of humans that are told apart [m]; the last one ends where presence does."""
HELD_OUT = 0.2
"""Share of the episodes that is held out."""
SAMPLES = 4000
"""Most held-out samples that are looked at."""


def auc(scores: FloatingArray, truth: BoolArray) -> float | None:
    """The probability that a true one scores above a false one, ties counting half; None if there is only one kind."""
    true, false = scores[truth], np.sort(scores[~truth])
    if not len(true) or not len(false):
        return None
    below = np.searchsorted(false, true, side="left") + np.searchsorted(false, true, side="right")
    return float(below.mean() / 2 / len(false))


def risk_scores(logits: FloatingArray, truth: BoolArray, usual: FloatingArray) -> dict[str, float | int | None]:
    """How well risks are told: over all commands, and among those of one state.

    Args:
        logits: Logits of the risk of each command, shape (N, C).
        truth: Which commands would meet it, shape (N, C).
        usual: How often each command met it in training, shape (C,).
    """
    blind = np.broadcast_to(usual, truth.shape)
    return {
        "auc": auc(logits.ravel(), truth.ravel()),
        "auc_blind": auc(blind.ravel(), truth.ravel()),
        "auc_within_state": auc_within_states(logits, truth),
        "auc_within_state_blind": auc_within_states(blind, truth),
        "states_that_vary": int((truth.any(axis=1) & ~truth.all(axis=1)).sum()),
        "share": float(truth.mean()),
    }


def auc_within_states(logits: FloatingArray, truth: BoolArray) -> float | None:
    """The mean of `auc` over the rows that have both kinds, shapes (N, C); None if there are none."""
    within = [auc(row, true) for row, true in zip(logits, truth, strict=True)]
    varied = [value for value in within if value is not None]
    return float(np.mean(varied)) if varied else None


def presence_scores(read: FloatingArray, humans: FloatingArray) -> dict[str, Any]:
    """How well the nearest visible human is read.

    Args:
        read: Logit of presence, bearing [rad], logarithm of the distance [m], shape (N, 3).
        humans: See `readygo.services.trainer.samples.SampleTable.humans`, shape (N, 3).
    """
    there = (humans[:, 0] > 0.5) & (humans[:, 2] < BINS_M[-1][1])
    scores: dict[str, Any] = {"auc": auc(read[:, 0], there), "share": float(there.mean())}
    for low, high in BINS_M:
        inside = there & (humans[:, 2] >= low)
        inside &= humans[:, 2] < high
        scores[f"auc_{low:g}_{high:g}_m"] = auc(read[inside | ~there, 0], inside[inside | ~there])
    if there.any():
        bearings_deg = np.degrees(np.abs(read[there, 1] - humans[there, 1]))
        shares = np.abs(np.exp(read[there, 2]) / humans[there, 2] - 1)
        scores["bearing_median_deg"], scores["bearing_p90_deg"] = np.percentile(bearings_deg, (50, 90)).tolist()
        scores["distance_median_share"] = float(np.median(shares))
    return scores


def answers_of(run: TrainRun, rows: Int64Array) -> tuple[torch.Tensor, torch.Tensor]:
    """What the averaged network answers to held-out samples, and what it reads of humans; see `PolicyNet.forward`."""
    learner, part = run.learner, run.held_out
    network, batches = learner.average.eval(), np.split(rows, range(VALIDATION_BATCH, len(rows), VALIDATION_BATCH))
    device = network.limits.device
    with torch.inference_mode():
        shown = (learner.objective.plain(part.table, part.frames, batch).to(device) for batch in batches)
        answers, humans = zip(*(learner.objective.answers(network, batch) for batch in shown), strict=True)
        return torch.cat(answers).float().cpu(), torch.cat(humans).float().cpu()


def scores_of(run: TrainRun) -> dict[str, Any]:
    """All scores on held-out samples.

    Raises:
        DatasetError: If the data do not name the risks of commands.
    """
    table = run.held_out.table
    rows = spread_samples(table, SAMPLES)
    rows = rows[table.risks[rows, 0] != UNKNOWN_RISK]
    if not len(rows):
        raise DatasetError(
            "The data do not name the risks of commands; record them with --driver.disturbed or --policy."
        )
    answers, read = answers_of(run, rows)
    likely, obstacle, human = answers.split(COMMAND_COUNT, dim=1)
    truth, known = table.risks[rows], run.training.table.risks
    known = known[known[:, 0] != UNKNOWN_RISK]
    expert = run.learner.average.bins.weights(torch.from_numpy(table.targets[rows] / table.limits(rows)))
    return {
        "cross_entropy": float(torch.nn.functional.cross_entropy(likely, expert)),
        "human_risk": risk_scores(human.numpy(), truth == HUMAN, (known == HUMAN).mean(axis=0)),
        "obstacle_risk": risk_scores(obstacle.numpy(), truth == OBSTACLE, (known == OBSTACLE).mean(axis=0)),
        "human_presence": presence_scores(read.numpy(), table.humans[rows]) if read.shape[1] else None,
    }


def probe(source: Dataset, config: TrainConfig) -> dict[str, Any]:
    """Train on most of the episodes, and score on the others."""
    with tempfile.TemporaryDirectory() as folder, training_threads(config):
        parts = build_parts(source, None, config)
        run = TrainRun(parts, robot_of_source(source), source.sensor, config, Path(folder), data={})
        while not run.is_over:
            run.step()
        counts = {
            "training_episodes": len(run.training.table.names),
            "held_out_episodes": len(run.held_out.table.names),
        }
        return {**counts, "samples_seen": run.samples_seen, "cpu_min": run.elapsed_s / 60, **scores_of(run)}


def config_of(settings: Sequence[str], minutes: float) -> TrainConfig:
    """The recipe `best` with settings NAME=VALUE; VALUE is JSON, or a word.

    Raises:
        ConfigError: If there is no such setting, or its value makes no sense.
    """
    given = dict(text.partition("=")[::2] for text in settings)
    fixed = {"minutes": minutes, "threads": 1, "validation_fraction": HELD_OUT, "validate_every": 10**9}
    try:
        config = make_config("best", **(fixed | {name: _value(text) for name, text in given.items()}))
    except TypeError as error:
        raise ConfigError(f"--set {' '.join(settings)}: {error}.") from error
    if config.network.output != "weighed":
        raise ConfigError(f"output must be 'weighed', got {config.network.output!r}: others tell no risks.")
    return section_from_mapping(TrainConfig, {k: v for k, v in section_to_mapping(config).items() if v is not None})


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def append(path: Path, row: dict[str, Any]) -> None:
    """Add a row to a file's JSON list, which need not be there."""
    rows = json.loads(path.read_text()) if path.is_file() else []
    path.write_text(json.dumps([*rows, row], indent=1) + "\n")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="+", type=Path, help="folders of shards, or shards")
    parser.add_argument("--minutes", type=float, default=2.0, help="processor time")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting of training")
    parser.add_argument("--out", type=Path, help="append the row to this JSON list")
    arguments = parser.parse_args()
    try:
        row = {"machine": machine(), "settings": arguments.set, "minutes": arguments.minutes}
        row |= probe(Dataset(arguments.data), config_of(arguments.set, arguments.minutes))
    except ReadygoError as error:
        parser.error(str(error))
    if arguments.out is not None:
        append(arguments.out, row)
    print(json.dumps(row))


if __name__ == "__main__":
    main()
