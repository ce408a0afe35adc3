"""What policies of equal budget learn from, and how they are put side by side."""

import dataclasses
from pathlib import Path

import pytest

from experiments.policy import arms
from experiments.policy.arms import Arm
from readygo.common.config import section_differences
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.runs.config import load_run_config
from readygo.services.evaluator import EpisodeRecord, Task
from tests.common.state_policy.state_policies import write_state_policy


@pytest.fixture
def job(tmp_path: Path) -> arms.Job:
    return arms.Job(
        scene="embedded",
        arms={
            "one": Arm(scenes=("embedded",)),
            "calm": Arm(scenes=("embedded",), settings="[human_planner]\nabsent = 1.0\n", crowded=False),
            "two": Arm(scenes=("embedded:plan-1", "embedded:plan-2")),
        },
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


def said_by(job: arms.Job) -> list[list[str]]:
    """All commands, in their order."""
    return [[str(word) for word in command] for step in arms.commands(job) for chain in step for command in chain]


def option(command: list[str], name: str) -> str:
    return command[command.index(name) + 1]


def test_arms_are_recorded_in_their_scenes_with_their_settings(job: arms.Job) -> None:
    arms.prepare(job)
    assert load_run_config(job.out / "calm.toml").human_planner.absent == 1.0
    assert section_differences(load_run_config(job.out / "one.toml"), load_run_config(None)) == []
    recorded = [command for command in said_by(job) if command[0] == "generate"]
    assert [(command[1], Path(option(command, "--config")).stem) for command in recorded[:8]] == [
        *[("embedded", "one")] * 2,
        *[("embedded", "calm")] * 2,
        *[("embedded:plan-1", "two")] * 2,
        *[("embedded:plan-2", "two")] * 2,
    ]
    crowds = {option(command, "--config") for command in recorded if "crowd" in command}
    assert crowds == {str(job.out / "one.toml"), str(job.out / "two.toml")}
    assert len({option(command, "--out") for command in recorded}) == len(recorded) == 12
    (teacher,) = [command for command in said_by(job) if command[0] == "rl"]
    assert teacher[1] == job.scene
    assert {option(command, "--teacher") for command in recorded} == {option(teacher, "--out")}


def test_teacher_that_is_there_labels_all_and_names_the_comparison(job: arms.Job, tmp_path: Path) -> None:
    taught = dataclasses.replace(job, teacher=write_state_policy(tmp_path / "rl"))
    commands = said_by(taught)
    assert not [command for command in commands if command[0] == "rl"]
    assert {option(command, "--teacher") for command in commands if command[0] == "generate"} == {str(tmp_path / "rl")}
    arms.prepare(taught)
    arms.prepare(dataclasses.replace(taught, teacher=write_state_policy(tmp_path / "copy")))
    with pytest.raises(RunError, match=r"begun with teacher [0-9a-f]{64}"):
        arms.prepare(job)


def test_perception_and_policies_learn_from_their_own_arm_alone(job: arms.Job) -> None:
    for command in said_by(job):
        if command[0] == "train":
            out = Path(option(command, "--out"))
            (arm,) = [arm for arm in job.arms if arm in out.parts]
            data = [Path(word) for word in command[1 : command.index("--recipe")]]
            assert {path.parent.parent for path in data} == {job.out / "data" / arm}
            assert len({path.parent for path in data}) == len(job.arms[arm].scenes)
            assert all(other not in word for other in job.arms if other != arm for word in command)


def test_policy_that_drives_the_last_data_learned_from_the_others(job: arms.Job) -> None:
    commands = said_by(job)
    made = [option(command, "--out") for command in commands]
    for arm in job.arms:
        first, driven = f"{job.out}/first/{arm}", [path for path in made if f"/{arm}/" in path and "driven" in path]
        assert len(driven) == len(job.arms[arm].scenes)
        for path in driven:
            assert option(commands[made.index(path)], "--policy") == first
        assert not set(driven) & set(commands[made.index(first)])
        for seed in range(2):
            last = commands[made.index(f"{job.out}/policies/{arm}/{seed}")]
            assert set(driven) <= set(last)
            assert option(last, "--seed") == str(seed)
            assert option(last, "--perception") == f"{job.out}/perception/{arm}/{seed}"
            assert max(map(made.index, driven)) < made.index(f"{job.out}/policies/{arm}/{seed}")
    assert len({option(c, "--seed") for c in commands if c[0] == "generate"}) == 3


def test_folder_of_another_budget_is_refused(job: arms.Job) -> None:
    arms.prepare(job)
    arms.prepare(dataclasses.replace(job, workers=2))
    with pytest.raises(RunError, match="begun with policy_samples 200"):
        arms.prepare(dataclasses.replace(job, policy_samples=300))
    with pytest.raises(RunError, match="begun with arms"):
        arms.prepare(dataclasses.replace(job, arms={"one": Arm(scenes=("embedded:1",))}))


def test_arms_are_compared_over_their_seeds() -> None:
    won, lost = Outcome.SUCCESS, Outcome.HUMAN_COLLISION
    outcomes = {
        "photoreal": ([won] * 20, [won] * 15 + [lost] * 5),
        "mesh": ([won] * 10 + [lost] * 10, [won] * 5 + [lost] * 15),
        "standing": ([lost] * 20, [lost] * 20),
        "absent": ([lost] * 20, [lost] * 20),
    }
    driven = [r for arm, of in outcomes.items() for k in (0, 1) for r in records(f"{arm}/{k}", of[k])]
    found = arms.tables(driven, list(outcomes), 2)
    mesh = found["arms"]["dynamic"]["mesh"]
    assert mesh["of_seeds"] == [50.0, 25.0]
    assert mesh["success"]["mean"] == pytest.approx(37.5)
    assert 10.0 < mesh["success"]["low"] < 30.0
    assert 45.0 < mesh["success"]["high"] < 70.0
    assert mesh["less_than_first"]["mean"] == pytest.approx(50.0)
    assert 0.0 < mesh["less_than_first"]["low"] < 50.0 < mesh["less_than_first"]["high"] < 90.0
    assert found["arms"]["dynamic"]["absent"]["success"] == {"mean": 0.0, "low": 0.0, "high": 0.0}
    assert found["measures"]["dynamic"]["photoreal/1"]["success"]["mean"] == pytest.approx(0.75)


def test_some_arms_can_be_compared_alone(job: arms.Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[arms.Job] = []

    def keep(chosen: arms.Job) -> dict[str, dict[str, object]]:
        compared.append(chosen)
        return {"measures": {}, "arms": {}, "comparisons": {}}

    monkeypatch.setattr(arms, "run", keep)
    for chosen, expected in (([], ["one", "calm", "two"]), (["--arms", "two", "one"], ["two", "one"])):
        options = vars(arms.parser_of("").parse_args(["embedded", "--out", str(tmp_path), *chosen]))
        arms.main("some", options, job.arms)
        assert list(compared[-1].arms) == expected
    options = vars(arms.parser_of("").parse_args(["embedded", "--out", str(tmp_path), "--arms", "none"]))
    with pytest.raises(SystemExit, match="There is no arm none; there are one, calm, two"):
        arms.main("some", options, job.arms)
