"""The third part of the form "paper": perception that learns from all images so far, and a policy that learns with it.

RUN/refined/perception/  the network of the first part, trained on with the data of both parts
RUN/refined/policy/      a policy from the data of the second part, with this network as its encoder
RUN/refined/data.json    hashes of the data
"""

import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from readygo.apps.learn.perceive import Step, training_step
from readygo.apps.learn.plan import REFINED_FOLDER, Budget, LearnPlan
from readygo.apps.learn.training import trainer_config
from readygo.common.dataset import Dataset
from readygo.common.documents import read_json, write_json
from readygo.common.errors import RunError
from readygo.runs.methods import PERCEPTION
from readygo.runs.origin import note_origin, origin_of_runs
from readygo.runs.perception import train_perception
from readygo.runs.training import run_training
from readygo.services.trainer import PerceptionConfig

DATA_FILE = "data.json"
PERCEPTION_SHARE, POLICY_SHARE = 0.45, 0.4
"""Shares of the time for perception and for the policy; reading images takes the rest."""
LEARNING_RATE = 1e-3
"""Largest learning rate of perception, whose weights are good already."""


def refine(plan: LearnPlan, show: Callable[[Step], None], *, before: Sequence[Path], minutes: float) -> Path:
    """Train perception and then a policy, or resume that; returns the folder of the policy.

    Args:
        plan: Plan of the second part, which has recorded its data.
        show: Told of the progress.
        before: Data folders of the first part, which perception has learned from.
        minutes: Wall time [min].

    Raises:
        PolicyError: If training cannot resume or its loss is not finite.
        DatasetError: If the data cannot be used.
    """
    out, data = plan.out / REFINED_FOLDER, [place.folder.path for place in plan.places]
    dataset = Dataset(data)
    _begin(out, [*(Dataset(folder).content_hash for folder in before), dataset.content_hash])
    config = PerceptionConfig(
        minutes=PERCEPTION_SHARE * minutes,
        seed=plan.seed,
        perception=str(plan.perception),
        learning_rate=LEARNING_RATE,
    )
    train_perception(
        [*before, *data],
        config,
        out / PERCEPTION,
        scenes=[place.scene for place in plan.places],
        show=lambda told: show(training_step("perception", told.fraction, told.train_loss)),
    )
    policy = out / "policy"
    run_training(
        dataset,
        trainer_config(plan, Budget(minutes=POLICY_SHARE * minutes), out / PERCEPTION),
        policy,
        show=lambda told: show(training_step("policy", told.fraction, told.train_loss)),
    )
    note_origin(policy, origin_of_runs(place.spec for place in plan.places))
    return policy


def _begin(out: Path, hashes: Sequence[str]) -> None:
    """Make the folder; what it has of other data, as before the second part recorded more, is removed."""
    path, found = out / DATA_FILE, None
    with suppress(OSError, ValueError):
        found = read_json(path)
    if found != list(hashes):
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        write_json(path, list(hashes), raises=RunError)
