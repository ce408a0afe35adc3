"""State policies of random weights."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.perception.noise import PERCEIVED, PerceptionNoise
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.state_policy import StatePolicy, StatePolicySpec, commands_of
from readygo.common.state_simulation.observe import ARC_COUNT, PEOPLE, PERSON_COUNT
from readygo.common.state_simulation.world import ARC_SPEEDS, ARC_TURNS, ObservationConfig

TOLD_COUNT = PEOPLE + ObservationConfig().people * PERSON_COUNT + (1 + len(ARC_SPEEDS) * len(ARC_TURNS)) * ARC_COUNT
"""Numbers that a robot is told by default."""


def make_state_policy(noise: PerceptionNoise = PERCEIVED, seed: int = 0, **changes: Any) -> StatePolicy:
    """A policy of one hidden layer that has learned nothing, with changes of its spec."""
    known = {"robot": RobotConfig(), "scenes": {"0" * 64: "hall"}, "noise": noise}
    rng, spec = np.random.default_rng(seed), StatePolicySpec(**{**known, **changes})
    sizes = [TOLD_COUNT, 16, len(commands_of(spec.robot))]
    layers = [
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after).astype(np.float32))
        for before, after in itertools.pairwise(sizes)
    ]
    return StatePolicy(spec=spec, layers=layers)


def write_state_policy(folder: Path, **changes: Any) -> Path:
    """A folder with such a policy."""
    make_state_policy(**changes).save(folder)
    return folder
