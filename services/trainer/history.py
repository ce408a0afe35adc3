"""The records that a training leaves on its way, in `PROGRESS_FILE` and in its checkpoint."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from readygo.common.drawing.charts import Curve

PROGRESS_FILE = "progress.json"
DECAY_FILE = "decay"
"""A file of this name in the run's folder begins the fall of the learning rate, which ends training."""


def loss_curves(history: Sequence[Mapping[str, Any]]) -> list[Curve]:
    """What training minimises, and the squared error on held-out episodes, over samples; empty without records."""
    samples = np.array([float(record["samples"]) for record in history])
    return [
        Curve(name=name, x=samples, y=np.array([float(record[key]) for record in history]))
        for name, key in (("training", "train_loss"), ("held out", "validation_loss"))
        if history
    ]
