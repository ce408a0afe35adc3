"""Trials of real robots, read from their logs as records of an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.drive.pilot import TrialEnding
from readygo.apps.drive.trial import OUTCOMES
from readygo.apps.drive.trial_log import RECORD
from readygo.common.dataset.ros_log import read_record
from readygo.common.documents import read_toml
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import DatasetError
from readygo.common.messages import EpisodeKey, Split
from readygo.services.evaluator import Category, EpisodeRecord, Task

LABELS_FILE = "labels.toml"
"""File beside the logs with outcomes that a person observed, such as `"trial-03.mcap" = "human_collision"`."""
_STOOD_MPS = 0.05


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial, from its log."""

    path: Path
    record: EpisodeRecord
    time_limit_s: float
    measures: Mapping[str, float]
    """Rates [Hz], latencies [ms] and image ages [s] by name, as `Measures.summary` returns them."""


def read_trials(folder: Path) -> list[Trial]:
    """All trials of a folder, or the one of a file, by name.

    Raises:
        DatasetError: If there are no logs, one cannot be read, or a label is unknown.
    """
    paths = [folder] if folder.is_file() else sorted(folder.glob("*.mcap"))
    if not paths:
        raise DatasetError(f"{folder} holds no logs (*.mcap) of `readygo drive --log`.")
    labels = _labels(paths[0].parent)
    unknown = sorted(set(labels) - {path.name for path in paths})
    if unknown and not folder.is_file():
        raise DatasetError(f"{folder / LABELS_FILE} names {unknown[0]}, which is not there.")
    return [_trial(path, index, labels.get(path.name)) for index, path in enumerate(paths)]


def mean_measures(trials: Sequence[Trial]) -> dict[str, float]:
    """Means of the measurements of the trials' loops by name; empty if no trial drove."""
    known = [trial.measures for trial in trials if trial.measures]
    return {name: round(sum(each[name] for each in known) / len(known), 2) for name in known[0]} if known else {}


def _trial(path: Path, index: int, label: TrialEnding | None) -> Trial:
    found = read_record(path, RECORD)
    try:
        return _of_record(path, found, index, label or TrialEnding[found["ending"].upper()])
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(f"{path} has a record of another version: {error!r}.") from error


def _of_record(path: Path, found: Mapping[str, Any], index: int, ending: TrialEnding) -> Trial:
    record = EpisodeRecord(
        episode=EpisodeKey(seed=0, split=Split.TEST, index=index),
        task=Task(found["task"]),
        method=str(found["policy"]),
        result=EpisodeResult(
            outcome=ending.outcome,
            duration_s=float(found["duration_s"]),
            path_length_m=float(found["driven_m"]),
            shortest_m=float(found["straight_m"]),
        ),
        human_distance_min_m=float("inf"),
        category=_category(ending, float(found["speed_at_end_mps"])),
        reason="" if ending in OUTCOMES.values() else str(found["reason"]),
    )
    return Trial(path=path, record=record, time_limit_s=float(found["time_limit_s"]), measures=dict(found["measures"]))


def _category(ending: TrialEnding, speed_mps: float) -> Category | None:
    """The kind of failure, as far as a log shows it; None for a success."""
    if ending is TrialEnding.GOAL:
        return None
    if ending is TrialEnding.STATIC_COLLISION:
        return Category.THING
    if ending is TrialEnding.HUMAN_COLLISION:
        return Category.WALKED_INTO if abs(speed_mps) < _STOOD_MPS else Category.SEEN_HUMAN
    if ending is TrialEnding.LATE:
        return Category.STUCK if abs(speed_mps) < _STOOD_MPS else Category.LATE
    return Category.DRIVER_FAILED


def _labels(folder: Path) -> dict[str, TrialEnding]:
    path = folder / LABELS_FILE
    if not path.is_file():
        return {}
    try:
        said = read_toml(path)
        return {name: OUTCOMES[outcome] for name, outcome in said.items()}
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read: {error}.") from error
    except (KeyError, TypeError) as error:
        raise DatasetError(f"{path}: {error} is no outcome; there are {', '.join(OUTCOMES)}.") from error
