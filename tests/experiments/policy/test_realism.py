"""What policies of equal budget are told to do, and how they are put side by side."""

import dataclasses
from pathlib import Path

import pytest

from experiments.policy import realism
from readygo.common.config import section_differences
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.runs.config import load_run_config
from readygo.services.evaluator import EpisodeRecord, Task


@pytest.fixture
def job(tmp_path: Path) -> realism.Job:
    return realism.Job(
        scene="embedded",
        out=tmp_path,
        seeds=2,
        episodes=8,
        decisions=1000,
        perception_samples=100,
        policy_samples=200,
        test=2,
        tasks=("dynamic",),
        workers=1,
    )


def records(method: str, outcomes: list[Outcome]) -> list[EpisodeRecord]:
    return [
        EpisodeRecord(
            episode=EpisodeKey(seed=0, split=Split.TEST, index=index),
            task=Task.DYNAMIC,
            method=method,
            result=EpisodeResult(outcome=outcome, duration_s=5.0, path_length_m=4.0, shortest_m=4.0),
            human_distance_min_m=1.0,
        )
        for index, outcome in enumerate(outcomes)
    ]


def said_by(job: realism.Job) -> list[list[str]]:
    """All commands, in their order."""
    return [[str(word) for word in command] for step in realism.commands(job) for chain in step for command in chain]


def option(command: list[str], name: str) -> str:
    return command[command.index(name) + 1]


def test_arms_differ_in_nothing_but_who_is_there(job: realism.Job) -> None:
    realism.prepare(job)
    configs = {arm: load_run_config(job.out / f"{arm}.toml") for arm in realism.ARMS}
    changed = {
        arm: {name for name, *_ in section_differences(configs["photoreal"], config)} for arm, config in configs.items()
    }
    assert changed == {
        "photoreal": set(),
        "mesh": {"renderer.human_look"},
        "standing": {
            "episode.human_count_min",
            "episode.human_count_max",
            "human_planner.standing_min",
            "human_planner.standing_max",
        },
        "absent": {"human_planner.absent"},
    }
    lines = {
        arm: [
            [word.replace(arm, "ARM") for word in command if word not in ("--people", "crowd")]
            for command in said_by(job)
            if f"/{arm}" in " ".join(command)
        ]
        for arm in realism.ARMS
    }
    assert all(found == lines["photoreal"] for found in lines.values())


def test_perception_and_policies_learn_from_their_own_arm_alone(job: realism.Job) -> None:
    for command in said_by(job):
        if command[0] == "train":
            out = Path(option(command, "--out"))
            (arm,) = [arm for arm in realism.ARMS if arm in out.parts]
            data = [Path(word) for word in command[1 : command.index("--recipe")]]
            assert {path.parent for path in data} == {job.out / "data" / arm}
            assert all(other not in word for other in realism.ARMS if other != arm for word in command)


def test_policy_that_drives_the_last_data_learned_from_the_others(job: realism.Job) -> None:
    commands = said_by(job)
    made = [option(command, "--out") for command in commands]
    for arm in realism.ARMS:
        first, driven = f"{job.out}/first/{arm}", f"{job.out}/data/{arm}/driven"
        assert option(commands[made.index(driven)], "--policy") == first
        assert driven not in commands[made.index(first)]
        for seed in range(2):
            last = commands[made.index(f"{job.out}/policies/{arm}/{seed}")]
            assert driven in last
            assert option(last, "--seed") == str(seed)
            assert option(last, "--perception") == f"{job.out}/perception/{arm}/{seed}"
            assert made.index(driven) < made.index(f"{job.out}/policies/{arm}/{seed}")
    assert len({option(c, "--seed") for c in commands if c[0] == "generate"}) == 3


def test_folder_of_another_budget_is_refused(job: realism.Job) -> None:
    realism.prepare(job)
    realism.prepare(dataclasses.replace(job, workers=2))
    with pytest.raises(RunError, match="begun with policy_samples 200"):
        realism.prepare(dataclasses.replace(job, policy_samples=300))


def test_arms_are_compared_over_their_seeds() -> None:
    won, lost = Outcome.SUCCESS, Outcome.HUMAN_COLLISION
    outcomes = {
        "photoreal": ([won] * 20, [won] * 15 + [lost] * 5),
        "mesh": ([won] * 10 + [lost] * 10, [won] * 5 + [lost] * 15),
        "standing": ([lost] * 20, [lost] * 20),
        "absent": ([lost] * 20, [lost] * 20),
    }
    found = realism.tables([r for arm, of in outcomes.items() for k in (0, 1) for r in records(f"{arm}/{k}", of[k])], 2)
    mesh = found["arms"]["dynamic"]["mesh"]
    assert mesh["of_seeds"] == [50.0, 25.0]
    assert mesh["success"]["mean"] == pytest.approx(37.5)
    assert 10.0 < mesh["success"]["low"] < 30.0
    assert 45.0 < mesh["success"]["high"] < 70.0
    assert mesh["less_than_photoreal"]["mean"] == pytest.approx(50.0)
    assert 0.0 < mesh["less_than_photoreal"]["low"] < 50.0 < mesh["less_than_photoreal"]["high"] < 90.0
    assert found["arms"]["dynamic"]["absent"]["success"] == {"mean": 0.0, "low": 0.0, "high": 0.0}
    assert found["measures"]["dynamic"]["photoreal/1"]["success"]["mean"] == pytest.approx(0.75)
