import dataclasses
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from readygo.apps.learn import refine as module
from readygo.apps.learn.perceive import Step
from readygo.apps.learn.plan import LearnPlan
from readygo.apps.learn.refine import LEARNING_RATE, PERCEPTION_SHARE, POLICY_SHARE, refine
from readygo.common.dataset import Dataset
from readygo.common.perception import PerceptionSpec
from readygo.common.perception.artifact import save_perception_spec
from readygo.common.policy import load_spec
from readygo.common.robot import RobotConfig
from readygo.runs.origin import origin_of_policy
from tests.common.policy.artifacts import write_policy


@pytest.fixture
def trainings(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What is trained, in order; trained perception and policies are there afterwards."""
    asked: list[tuple[Any, ...]] = []

    def train_perception(data: Any, config: Any, out: Path, *, scenes: Any, show: Any) -> None:
        asked.append(("perception", data, config, out, scenes))
        out.mkdir(exist_ok=True)
        save_perception_spec(PerceptionSpec(robot=RobotConfig(), spacing_s=0.4), out)
        show(SimpleNamespace(fraction=0.5, train_loss=0.25))

    def run_training(dataset: Dataset, config: Any, out: Path, *, show: Any) -> None:
        asked.append(("policy", dataset, config, out))
        write_policy(out)
        show(SimpleNamespace(fraction=0.75, train_loss=1.0))
        show(SimpleNamespace(fraction=0.8, train_loss=math.nan))

    monkeypatch.setattr(module, "train_perception", train_perception)
    monkeypatch.setattr(module, "run_training", run_training)
    return asked


def test_perception_learns_from_all_data_and_then_the_policy_from_those_of_this_run(
    tiny: LearnPlan, trainings: list[tuple[Any, ...]], tmp_path: Path
) -> None:
    recorded = tiny.places[0].folder.path
    plan, steps = dataclasses.replace(tiny, out=tmp_path, perception=tmp_path / "perception", seed=7), list[Step]()
    policy = refine(plan, steps.append, before=[recorded], minutes=20.0)
    (_, data, config, perception, scenes), (_, dataset, training, out) = trainings
    assert (data, scenes) == ([recorded, recorded], ["embedded"])
    assert (config.minutes, config.seed) == (20 * PERCEPTION_SHARE, 7)
    assert (config.perception, config.learning_rate) == (str(tmp_path / "perception"), LEARNING_RATE)
    assert dataset.content_hash == Dataset([recorded]).content_hash
    assert (training.minutes, training.seed, training.threads) == (20 * POLICY_SHARE, 7, 0)
    assert (training.perception, training.network.encoder) == (str(perception), "perception")
    assert training.sampling.frame_spacing_s == 0.4
    assert (perception, out, policy) == (tmp_path / "refined" / "perception", tmp_path / "refined" / "policy", out)
    assert [(step.name, step.fraction, step.words) for step in steps] == [
        ("perception", 0.5, "loss 0.25"),
        ("policy", 0.75, "loss 1.00"),
        ("policy", 0.8, ""),
    ]
    origin = origin_of_policy(load_spec(policy))
    assert origin is not None
    assert set(origin.scenes.values()) == {"embedded"}


def test_training_on_the_same_data_resumes_and_on_others_it_begins_again(
    tiny: LearnPlan, trainings: list[tuple[Any, ...]], tmp_path: Path
) -> None:
    recorded = tiny.places[0].folder.path
    plan = dataclasses.replace(tiny, out=tmp_path, perception=tmp_path / "perception")
    refine(plan, lambda _: None, before=[], minutes=1.0)
    checkpoint = tmp_path / "refined" / "perception" / "checkpoint.pt"
    checkpoint.touch()
    refine(plan, lambda _: None, before=[], minutes=1.0)
    assert checkpoint.exists()
    refine(plan, lambda _: None, before=[recorded], minutes=1.0)
    assert not checkpoint.exists()
    hashes = json.loads((tmp_path / "refined" / "data.json").read_text())
    assert hashes == [Dataset([recorded]).content_hash] * 2
    checkpoint.touch()
    (tmp_path / "refined" / "data.json").write_text("{")
    refine(plan, lambda _: None, before=[recorded], minutes=1.0)
    assert not checkpoint.exists()
