"""What policies of equal budget are told to do, and how they are put side by side."""

import dataclasses
from pathlib import Path

import pytest

from experiments.policy import realism
from readygo.apps.learn.plan import learn_settings
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.services.evaluator import EpisodeRecord, Task


@pytest.fixture
def job(tmp_path: Path) -> realism.Job:
    return realism.Job(
        scene="embedded",
        out=tmp_path,
        avatars="embedded",
        samples=100,
        test=2,
        test_scenes=(),
        methods=("straight-line", "gnm"),
        network_samples=50,
        workers=1,
        seed=0,
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


def test_arms_differ_in_nothing_but_who_is_there(job, monkeypatch) -> None:
    said = []
    monkeypatch.setattr(realism, "_readygo", lambda *arguments: said.append([str(word) for word in arguments]))
    realism.prepare(job)
    for arm in realism.ARMS:
        realism.make_policy(job, arm)
    configs = [learn_settings(Path(line.pop(line.index("--config") + 1)), None) for line in said]
    assert [config.renderer.human_look for config in configs] == ["photoreal", "mesh", "photoreal"]
    assert [config.human_planner.absent for config in configs] == [0.3, 0.3, 1.0]
    alike = [
        dataclasses.replace(config, human_planner=configs[0].human_planner, renderer=configs[0].renderer)
        for config in configs
    ]
    assert alike[1] == alike[2] == configs[0]
    outs = [line.pop(line.index("--out") + 1) for line in said]
    assert outs == [str(job.out / arm) for arm in realism.ARMS]
    assert said[0] == said[1] == said[2]
    assert said[0][:2] == ["learn", "embedded"]
    assert " ".join(said[0]).endswith("--avatars embedded:train --samples 100 --seed 0 --episodes 0")


def test_a_folder_of_another_budget_is_refused(job) -> None:
    realism.prepare(job)
    realism.prepare(job)
    with pytest.raises(RunError, match="begun with samples 100"):
        realism.prepare(dataclasses.replace(job, samples=200))


def test_networks_that_are_asked_for_learn_from_the_photoreal_arm_once(job, monkeypatch) -> None:
    said = []

    def run(*arguments: object) -> None:
        said.append(" ".join(map(str, arguments)))
        (job.out / "checkpoints").mkdir()
        (job.out / "checkpoints" / "gnm_large.pth").touch()

    data = job.out / "photoreal" / "data" / "embedded"
    data.mkdir(parents=True)
    monkeypatch.setattr(realism, "_readygo", run)
    realism.train_networks(job)
    realism.train_networks(job)
    assert [line.split(" --out")[0] for line in said] == [f"train {data} --recipe gnm"]
    assert said[0].endswith("--samples 50 --seed 0")


def test_arms_are_compared_on_their_common_episodes() -> None:
    won, lost = Outcome.SUCCESS, Outcome.HUMAN_COLLISION
    found = realism.tables([*records("photoreal", [won, won, lost]), *records("mesh", [lost, won, lost])])
    assert found["measures"]["dynamic"]["mesh"]["success"]["mean"] == pytest.approx(1 / 3)
    (comparison,) = found["comparisons"]
    assert (comparison["only_method"], comparison["only_reference"]) == (0, 1)


def test_records_carry_the_name_of_their_arm(job, monkeypatch) -> None:
    def evaluate(*arguments: object) -> None:
        words = [str(word) for word in arguments]
        assert words[words.index("--avatars") + 1] == "embedded:test"
        assert words[words.index("--unseen") + 1] == "avatars"
        assert words[words.index("--methods") + 1 :][:4] == ["policy", "expert", "straight-line", "gnm"]
        out = Path(words[words.index("--out") + 1])
        out.mkdir()
        policy = records("policy", [Outcome.SUCCESS])[0]
        lines = [policy, dataclasses.replace(policy, method="expert")]
        (out / "episodes.jsonl").write_text("".join(f"{realism.json.dumps(r.to_mapping())}\n" for r in lines))

    monkeypatch.setattr(realism, "_readygo", evaluate)
    assert [record.method for record in realism.evaluate(job, "photoreal", "embedded")] == ["expert", "photoreal"]
