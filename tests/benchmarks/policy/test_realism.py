"""What policies of equal budget are told to do, and how they are put side by side."""

import dataclasses
import tomllib
from pathlib import Path

import pytest

from readygo.benchmarks.policy import realism
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
        episodes=5,
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
    looks = [
        tomllib.loads(Path(line[line.index("--config") + 1]).read_text()) for line in said if line[0] == "generate"
    ]
    assert [look["renderer"].pop("human_look") for look in looks] == ["photoreal", "mesh", "photoreal"]
    assert looks[0] == looks[1] == looks[2]
    assert ["--static" in line for line in said if line[0] == "generate"] == [False, False, True]
    assert ["embedded:train" in line for line in said if line[0] == "generate"] == [True, True, False]
    trained = [line[line.index("--samples") :] for line in said if line[0] == "train"]
    assert trained[0] == trained[1] == trained[2]


def test_what_is_done_is_not_done_again_and_a_folder_of_another_budget_is_refused(job, monkeypatch) -> None:
    said = []
    monkeypatch.setattr(realism, "_readygo", lambda *arguments: said.append(arguments[0]))
    realism.prepare(job)
    (job.out / "mesh-policy").mkdir()
    (job.out / "mesh-policy" / "metrics.json").write_text("{}")
    realism.make_policy(job, "mesh")
    assert said == []
    realism.prepare(job)
    realism.make_policy(job, "photoreal")
    assert said == ["generate", "train"]
    with pytest.raises(RunError, match="begun with samples 100"):
        realism.prepare(dataclasses.replace(job, samples=200))


def test_networks_that_are_asked_for_learn_from_the_photoreal_arm_once(job, monkeypatch) -> None:
    said = []

    def run(*arguments: object) -> None:
        said.append(" ".join(map(str, arguments)))
        (job.out / "checkpoints").mkdir()
        (job.out / "checkpoints" / "gnm_large.pth").touch()

    monkeypatch.setattr(realism, "_readygo", run)
    realism.train_networks(job)
    realism.train_networks(job)
    assert [line.split(" --out")[0] for line in said] == [f"train {job.out / 'photoreal-data'} --recipe gnm"]
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
