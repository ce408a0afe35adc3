import pytest

from readygo.apps.drive.trial_log import RECORD
from readygo.apps.drive.trials import mean_measures, read_trials
from readygo.common.dataset.ros_log import RosLogWriter
from readygo.common.errors import DatasetError
from readygo.common.messages import Outcome
from readygo.services.evaluator import Category, Task


def write_trial(path, ending="goal", **changes):
    record = {
        "policy": "lobby",
        "policy_sha256": "ab",
        "task": "dynamic",
        "time_limit_s": 50.0,
        "ending": ending,
        "reason": ending,
        "duration_s": 12.5,
        "driven_m": 6.0,
        "straight_m": 5.0,
        "goal_distance_m": 0.9,
        "speed_at_end_mps": 0.4,
        "measures": {"inference_hz": 20.0, "latency_p99_ms": 9.0},
    }
    with RosLogWriter(path) as log:
        log.add_record(RECORD, record | changes)


def test_logs_become_the_records_of_an_evaluation(tmp_path):
    write_trial(tmp_path / "a.mcap")
    write_trial(tmp_path / "b.mcap", "human_collision")
    write_trial(tmp_path / "c.mcap", "human_collision", speed_at_end_mps=0.0)
    write_trial(tmp_path / "d.mcap", "late", task="static", measures={})
    write_trial(tmp_path / "e.mcap", "stale", reason="no new images for 10 s")
    trials = read_trials(tmp_path)
    records = [trial.record for trial in trials]
    assert [record.result.outcome for record in records] == [
        Outcome.SUCCESS,
        Outcome.HUMAN_COLLISION,
        Outcome.HUMAN_COLLISION,
        Outcome.TIMEOUT,
        Outcome.TIMEOUT,
    ]
    kinds = [None, Category.SEEN_HUMAN, Category.WALKED_INTO, Category.LATE, Category.DRIVER_FAILED]
    assert [record.category for record in records] == kinds
    assert [record.task for record in records][3] is Task.STATIC
    assert [record.reason for record in records] == ["", "", "", "", "no new images for 10 s"]
    assert records[0].result.duration_s == 12.5
    assert mean_measures(trials) == {"inference_hz": 20.0, "latency_p99_ms": 9.0}


def test_labels_say_what_no_log_knows(tmp_path):
    write_trial(tmp_path / "a.mcap", "stopped")
    (tmp_path / "labels.toml").write_text('"a.mcap" = "static_collision"\n')
    assert read_trials(tmp_path)[0].record.category is Category.THING
    (tmp_path / "labels.toml").write_text('"a.mcap" = "crash"\n')
    with pytest.raises(DatasetError, match="'crash' is no outcome; there are success, timeout"):
        read_trials(tmp_path)
    (tmp_path / "labels.toml").write_text('"b.mcap" = "timeout"\n')
    with pytest.raises(DatasetError, match=r"names b\.mcap, which is not there"):
        read_trials(tmp_path)


def test_folders_without_trials_and_other_logs_are_refused(tmp_path):
    with pytest.raises(DatasetError, match="holds no logs"):
        read_trials(tmp_path)
    with RosLogWriter(tmp_path / "a.mcap"):
        pass
    with pytest.raises(DatasetError, match="no `readygo drive --log` wrote it"):
        read_trials(tmp_path)
