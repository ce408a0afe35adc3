import dataclasses
import json
import shutil
from pathlib import Path

import pytest

from readygo.apps.learn import measure as module
from readygo.apps.learn.measure import Measuring, success_rate, tried_settings
from readygo.apps.learn.plan import LearnPlan
from readygo.common.avatars.cast import load_cast
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world
from readygo.runs.world import World
from readygo.services.evaluator import EXPERT, POLICY, STRAIGHT_LINE, EpisodeRecord, EvaluateReply, Task


class StopError(Exception):
    pass


def test_policies_are_tried_as_evaluate_does_it(tiny: LearnPlan) -> None:
    settings = tried_settings(tiny)
    assert settings.human_planner.absent == 0.0, "the dynamic task has humans in every episode"
    assert settings.renderer.detail == "lod"
    assert (settings.robot, settings.episode) == (tiny.config.robot, tiny.config.episode)


def test_measurement_is_of_both_tasks_and_can_be_ended(tiny: LearnPlan) -> None:
    measuring = Measuring(tiny)
    measured = measuring.val(tiny.policy, "ab", 2, 0.5)
    assert (measured.measurement.policy, measured.measurement.episodes, measured.folder) == ("ab", 2, tiny.policy)
    assert measured.episode_s > 0

    told: list[tuple[str, Task]] = []

    def report(name: str, record: EpisodeRecord) -> None:
        told.append((name, record.task))
        raise StopError

    with pytest.raises(StopError):
        measuring.val(tiny.policy, "ab", 2, 0.5, report=report)
    assert [name for name, _ in told] == ["embedded"]


def test_avatars_of_the_test_walk_in_the_test_alone(
    tiny: LearnPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path | None] = []

    def world(scene: str, config: RunConfig, *, avatars: Path | None, seed: int) -> World:
        asked.append(avatars)
        return evaluation_world(scene, config, avatars=avatars, seed=seed)

    monkeypatch.setattr(module, "evaluation_world", world)
    train, test = Path("embedded:train"), Path("embedded:test")
    measuring = Measuring(dataclasses.replace(tiny, avatars=train, tested=test))
    for _ in range(2):
        measuring.val(tiny.policy, "ab", 1, 0.5)
    measuring.test(tiny.policy, 1, tmp_path, lambda _: None)
    assert asked == [train, test]
    settings = json.loads((tmp_path / "embedded" / "settings.json").read_text())
    assert set(settings["avatars"]) == set(load_cast(test))


def test_test_episodes_are_driven_by_all_and_written_down(tiny: LearnPlan, tmp_path) -> None:
    records: list[EpisodeRecord] = []
    replies = Measuring(tiny).test(tiny.policy, 1, tmp_path, records.append)
    assert {(record.task, record.method) for record in records} == {
        (t, m) for t in (Task.STATIC, Task.DYNAMIC) for m in (POLICY, EXPERT, STRAIGHT_LINE)
    }
    assert list(replies) == ["embedded"]
    assert (tmp_path / "embedded" / "summary.json").exists()
    assert (tmp_path / "embedded" / "report.html").exists()
    failed = any(record.method == POLICY and record.result.outcome is not Outcome.SUCCESS for record in records)
    assert (tmp_path / "embedded" / "failures.html").exists() == failed


def test_test_episodes_that_are_there_are_not_driven_again(tiny: LearnPlan, tmp_path) -> None:
    driven: list[EpisodeRecord] = []
    policy = shutil.copytree(tiny.policy, tmp_path / "policy")

    def test(episodes: int) -> tuple[int, dict[str, EvaluateReply]]:
        driven.clear()
        replies = Measuring(tiny).test(policy, episodes, tmp_path / "evaluation", driven.append)
        return len(driven), replies

    _, first = test(1)
    written = (tmp_path / "evaluation" / "embedded" / "episodes.jsonl").read_bytes()
    _, again = test(1)
    assert (tmp_path / "evaluation" / "embedded" / "episodes.jsonl").read_bytes() == written
    assert [record.to_mapping() for record in again["embedded"].records] == [
        record.to_mapping() for record in first["embedded"].records
    ]
    assert again["embedded"].summaries.keys() == first["embedded"].summaries.keys()
    (policy / "policy.toml").write_text((policy / "policy.toml").read_text() + "\n")
    test(1)
    assert len((tmp_path / "evaluation" / "embedded" / "episodes.jsonl").read_text().splitlines()) == 6
    assert "policy" in (tmp_path / "evaluation" / "embedded" / "settings.json").read_text()
    assert test(2)[0] == 12, "those that are kept are told of as well"
    lines = (tmp_path / "evaluation" / "embedded" / "episodes.jsonl").read_text().splitlines()
    assert len(lines) == 12, "more episodes: only those that were missing"


def test_rate_of_a_task_is_that_of_its_own_episodes() -> None:
    outcomes = {
        Task.STATIC: [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.TIMEOUT, Outcome.SUCCESS],
        Task.DYNAMIC: [Outcome.HUMAN_COLLISION, Outcome.SUCCESS, Outcome.STATIC_COLLISION],
    }
    records = [
        EpisodeRecord(
            episode=EpisodeKey(seed=0, split=Split.VAL, index=index),
            task=task,
            method=POLICY,
            result=EpisodeResult(outcome=outcome, duration_s=3.0, path_length_m=2.0, shortest_m=2.0),
            human_distance_min_m=1.0,
        )
        for task, found in outcomes.items()
        for index, outcome in enumerate(found)
    ]
    assert success_rate(records, Task.STATIC) == 0.75
    assert success_rate(records, Task.DYNAMIC) == pytest.approx(1 / 3)
