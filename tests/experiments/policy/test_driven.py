from pathlib import Path

import pytest

from experiments.policy import driven
from experiments.policy.driven import DRIVEN, EVALUATOR, Ending, Job, compared, endings_of, measures_of
from readygo.common.messages import Outcome
from tests.common.policy.artifacts import write_policy

SAID = """a robot waits at tcp/127.0.0.1:7447
static test-0-000000: success after 7.10 s
static test-0-000001: static_collision after 12.35 s
dynamic test-0-000000: human_collision after 5.50 s
static: 1 of 2 succeed
"""


def test_what_a_simulated_robot_says_is_read() -> None:
    found = endings_of(SAID.splitlines())
    assert found == {
        "static": {
            "test-0-000000": Ending(outcome=Outcome.SUCCESS, time_s=7.1),
            "test-0-000001": Ending(outcome=Outcome.STATIC_COLLISION, time_s=12.35),
        },
        "dynamic": {"test-0-000000": Ending(outcome=Outcome.HUMAN_COLLISION, time_s=5.5)},
    }


def test_measures_are_shares_with_an_interval() -> None:
    found = measures_of(endings_of(SAID.splitlines())["static"])
    assert (found["success"]["mean"], found["success"]["count"]) == (0.5, 2)
    assert 0.0 < found["success"]["low"] < 0.5 < found["success"]["high"] < 1.0
    assert (found["static_collision"]["mean"], found["timeout"]["mean"]) == (0.5, 0.0)


def test_rows_are_beside_the_evaluator_in_the_episodes_that_both_have() -> None:
    def rows(outcomes: str) -> dict[str, dict[str, Ending]]:
        kinds = {"+": Outcome.SUCCESS, "-": Outcome.TIMEOUT}
        return {"static": {str(k): Ending(outcome=kinds[mark], time_s=1.0) for k, mark in enumerate(outcomes)}}

    found = compared({EVALUATOR: rows("++--+"), DRIVEN: rows("+--+")}, ["static"])
    (beside,) = found["comparisons"]
    assert (beside["episodes"], beside["only_method"], beside["only_reference"]) == (4, 1, 1)
    assert (beside["task"], beside["method"], beside["mcnemar_p"]) == ("static", DRIVEN, 1.0)
    assert list(found["measures"]["static"]) == [EVALUATOR, DRIVEN]


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Job:
    pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
    policy, settings = write_policy(tmp_path / "policy"), tmp_path / "run.toml"
    settings.write_text("[episode]\ntime_limit_s = 1.0\n")
    job = Job(scene="embedded", policy=policy, out=tmp_path / "out", episodes=1, tasks=("static",), seed=0)
    monkeypatch.setattr(Job, "drawn", ("--episodes", "1", "--seed", "0", "--config", str(settings)))
    return job


def test_robot_is_driven_by_another_program_once(job: Job) -> None:
    # A log of an earlier try that was cut off.
    (job.out / "static").mkdir(parents=True)
    (job.out / "static" / "000.mcap").write_bytes(b"")
    found = driven.driven(job)
    (ending,) = found["static"].values()
    assert ending.time_s <= 1.0 + 1e-6
    spent = driven.latencies(job)
    assert 0.0 < spent["median_ms"] <= spent["p99_max_ms"]
    (job.out / "static" / "000.mcap").unlink()
    assert driven.driven(job) == found
    assert not (job.out / "static" / "000.mcap").exists()


def test_robot_that_does_not_start_is_told_and_nothing_of_it_is_kept(tmp_path: Path) -> None:
    job = Job(scene="embedded", policy=tmp_path / "none", out=tmp_path / "out", episodes=1, tasks=("static",), seed=0)
    with pytest.raises(SystemExit, match="robot of static ended before its episodes were over"):
        driven.driven(job)
    assert not (job.out / "static" / driven.OUTCOMES_FILE).exists()


def test_robot_that_still_waits_after_the_last_drive_is_ended(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driven, "ENDS_S", 0.2)
    # The robot has one episode more than there are drives.
    monkeypatch.setattr(Job, "drawn", ("--episodes", "2", *job.drawn[2:]))
    with pytest.raises(SystemExit, match="robot of static ended before its episodes were over"):
        driven.driven(job)


def test_evaluator_and_rehearsal_drive_the_same_episodes(job: Job) -> None:
    assert list(driven.evaluated(job)["static"]) == list(driven.rehearsed(job)["static"]) == ["test-0-000000"]
