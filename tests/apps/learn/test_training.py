import dataclasses
import json
import time
from pathlib import Path

import pytest

from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.plan import Budget, LearnPlan
from readygo.apps.learn.training import (
    Training,
    begin_decay,
    forget_decay,
    read_history,
    read_training,
    write_trainer_config,
)
from readygo.common.perception.artifact import PerceptionSpec, save_perception_spec
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.training import make_config
from readygo.services.trainer import best_recipe, live
from readygo.services.trainer.config import pretrained_recipe

TOLD = {
    "state": "training",
    "fraction": 0.4,
    "minutes": 0.5,
    "steps": 100,
    "samples": 24_000,
    "success": {"static": {"episodes": 4, "rate": 0.5}, "dynamic": {"episodes": 0, "rate": None}},
    "offers": [
        {"step": 50, "folder": "candidates/0000050", "version": 1, "sha256": "ab"},
        {"step": 90, "folder": "candidates/0000090"},
    ],
    "history": [
        {"step": 50, "samples": 12_000, "train_loss": 0.2, "validation_loss": 0.3},
        {"step": 60, "samples": 14_000, "train_loss": float("nan"), "validation_loss": 0.3},
        {"train_loss": 0.1},
    ],
}


def told(folder: Path, **changes: object) -> Training:
    (folder / live.PROGRESS_FILE).write_text(json.dumps({**TOLD, **changes}))
    return read_training(folder)


def test_nothing_is_known_before_the_trainer_says_something(tmp_path: Path) -> None:
    assert read_training(tmp_path) == Training()
    assert read_history(tmp_path) == []
    (tmp_path / live.PROGRESS_FILE).write_text("{")
    assert read_training(tmp_path) == Training()
    assert Training().samples_hz == 0.0


def test_newest_policy_is_the_last_one_that_the_fleet_took(tmp_path: Path) -> None:
    training = told(tmp_path)
    assert training.offered is not None
    assert (training.offered.sha256, training.offered.folder) == ("ab", tmp_path / "candidates/0000050")
    assert len(read_history(tmp_path)) == 2
    assert (training.loss, training.driven, training.samples_hz) == (0.1, 0.5, 800.0)


def test_trainer_has_ended_only_with_its_budget(tmp_path: Path) -> None:
    assert not told(tmp_path).ended
    assert not told(tmp_path, state="ended").ended, "it was stopped, and is to go on"
    assert told(tmp_path, state="ended", fraction=1.0).ended
    assert not read_training(tmp_path, since_s=time.time() + 1.0).ended, "it was an earlier one"


def test_fall_of_the_rate_is_asked_for_and_taken_back(tmp_path: Path) -> None:
    forget_decay(tmp_path)
    begin_decay(tmp_path)
    assert (tmp_path / live.DECAY_FILE).exists()
    forget_decay(tmp_path)
    assert not (tmp_path / live.DECAY_FILE).exists()


def test_progress_of_another_shape_says_nothing(tmp_path: Path) -> None:
    for text in (
        "3",
        "[" * 100_000,
        '{"success": 1}',
        '{"success": {}, "history": [3], "offers": []}',
        '{"history": 3}',
    ):
        (tmp_path / "progress.json").write_text(text)
        assert read_training(tmp_path) == Training()
        assert read_history(tmp_path) == []


@pytest.mark.parametrize("encoder", [None, "perception"])
def test_trainer_reads_the_recipe_of_the_plan(tmp_path: Path, encoder: str | None) -> None:
    perception = tmp_path / encoder if encoder else None
    if perception:
        save_perception_spec(PerceptionSpec(robot=RobotConfig(), spacing_s=0.5), perception)
    plan = LearnPlan(
        out=tmp_path,
        places=(),
        config=RunConfig(),
        learn=LearnConfig(),
        budget=Budget(minutes=30.0, samples=9000),
        avatars=None,
        tested=None,
        seed=4,
        perception=perception,
    )
    read = make_config("best", write_trainer_config(plan, 3))
    recipe = pretrained_recipe() if encoder else best_recipe()
    spacing_s = 0.5 if encoder else recipe.sampling.frame_spacing_s
    sampling = dataclasses.replace(recipe.sampling, frame_spacing_s=spacing_s)
    assert (read.network, read.sampling, read.optimizer) == (recipe.network, sampling, recipe.optimizer)
    assert (read.minutes, read.samples, read.seed, read.threads, read.offer_every_s) == (30.0, 9000, 4, 3, 30.0)
    assert read.perception == (str(perception) if perception else "")
    write_trainer_config(dataclasses.replace(plan, learn=LearnConfig(memory=7)), 3)
    assert make_config("best", tmp_path / "trainer.toml").network.memory_count == 7
