import io
import json

import numpy as np
import pytest

from readygo.apps.terminal import PlainConsole
from readygo.services.evaluator import (
    STRAIGHT_LINE,
    EvaluateRequest,
    Task,
    handle_evaluate,
    summary_mapping,
    summary_table,
)
from readygo.services.evaluator.records import record_of_mapping


def test_nearest_human_is_recorded(make_evaluator):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(STRAIGHT_LINE,), episodes=1)
    record = handle_evaluate(make_evaluator(), request).records[0]
    # The walker comes down to (3, 4) and stays; the robot passes at y = 1.
    assert record.human_distance_min_m == pytest.approx(3.0, abs=0.05)


def test_table_shows_rates_and_interval(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3, tasks=(Task.STATIC,)))
    console = PlainConsole(width=80, record=True, file=io.StringIO())
    console.print(summary_table(reply.summaries))
    text = console.export_text()
    assert "straight-line" in text
    assert "66.7" in text
    assert np.all([name in text for name in ("SR %", "95 %", "ART s", "SPL", "late %")])


def test_record_is_read_as_it_was_written(make_evaluator):
    records = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1)).records
    assert [record_of_mapping(json.loads(json.dumps(record.to_mapping()))) for record in records] == list(records)
    assert records[0].to_mapping()["human_distance_min_m"] is None


@pytest.mark.parametrize("name", ["duration_s", "path_length_m", "shortest_m", "human_distance_min_m"])
@pytest.mark.parametrize("value", ["abc", [], {}, True, -1.0, float("nan"), float("inf")])
def test_measure_that_is_no_finite_number_from_zero_is_refused(make_evaluator, name: str, value: object):
    (record, *_) = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1)).records
    with pytest.raises(ValueError, match=f"{name} must be a finite number of at least 0"):
        record_of_mapping({**record.to_mapping(), name: value})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"duration_s": None}, "duration_s must be a finite number"),
        ({"index": 1.5}, "index must be a whole number, got 1.5"),
        ({"seed": True}, "seed must be a whole number, got True"),
        ({"category": 3}, "KeyError: '3'"),
        ({"outcome": []}, "is not a valid Outcome"),
        ({"conduct": {"intrusion_s": 0.0}}, "ConfigError: Keys near_misses"),
        ({"conduct": "none"}, "ConfigError: Conduct must be a table"),
    ],
)
def test_record_with_a_damaged_value_is_refused(make_evaluator, changes: dict[str, object], said: str):
    (record, *_) = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1)).records
    with pytest.raises(ValueError, match=said):
        record_of_mapping({**record.to_mapping(), **changes})


def test_social_measure_that_is_not_finite_is_refused(make_evaluator):
    (record, *_) = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1)).records
    conduct = record.to_mapping()["conduct"]
    with pytest.raises(ValueError, match="jerk_mps3 must be a finite number"):
        record_of_mapping({**record.to_mapping(), "conduct": {**conduct, "jerk_mps3": float("nan")}})


def test_scores_are_plain_values_by_task_and_method(make_evaluator):
    summary = summary_mapping(handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3)).summaries)
    assert summary["static"]["straight-line"]["success_rate"] == pytest.approx(2 / 3)
    assert summary["static"]["straight-line"]["static_collision_rate"] == pytest.approx(1 / 3)
    assert summary["static"]["expert"]["success_rate"] == pytest.approx(2 / 3)
