"""Learning curve of a run, in `curve.json`: recorded samples, training and measurements over time."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.learn.choice import PolicyMeasurement
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_json
from readygo.common.errors import ConfigError, RunError, cause
from readygo.common.files import write_whole


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """Progress of a run at one time."""

    minutes: float
    """Time spent, including earlier commands [min]."""
    recorded: int
    """Number of samples with an image in the shards."""
    learned: int
    """Number of samples that training has used, repeats counted."""
    policies: int
    """Number of policies that were offered."""
    loss: float | None = None
    """Training loss since the previous point; None if unknown."""
    driven: float | None = None
    """Success rate of the latest recorded episodes that policies drove; None before there are any."""
    measurement: PolicyMeasurement | None = None
    """Measurement on the split val at this point; None without one."""


def load_curve(path: Path) -> list[CurvePoint]:
    """Read the points so far; an empty list without a file.

    Raises:
        RunError: If the file is broken.
    """
    try:
        return [section_from_mapping(CurvePoint, point) for point in read_json(path)["points"]]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError, TypeError, ConfigError) as error:
        raise RunError(f"{path} cannot be read: {cause(error)}; remove it, or choose another --out.") from error


def save_curve(path: Path, points: Sequence[CurvePoint]) -> None:
    """Write all points."""
    text = json.dumps({"points": [section_to_mapping(point) for point in points]}, indent=1)
    write_whole(path, text + "\n", raises=RunError)


def measurements_of(points: Sequence[CurvePoint]) -> list[PolicyMeasurement]:
    """The measurements among the points, in order."""
    return [point.measurement for point in points if point.measurement is not None]
