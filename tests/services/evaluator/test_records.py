import io
import json

import numpy as np
import pytest
from rich.console import Console

from readygo.services.evaluator import (
    EvaluateRequest,
    Method,
    Task,
    handle_evaluate,
    read_results,
    summary_mapping,
    summary_table,
    write_results,
)


def test_nearest_human_is_recorded(make_evaluator):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(Method.STRAIGHT_LINE,), episodes=1)
    record = handle_evaluate(make_evaluator(), request).records[0]
    # The walker comes down to (3, 4) and stays; the robot passes at y = 1.
    assert record.human_distance_min_m == pytest.approx(3.0, abs=0.05)


def test_results_are_written_as_records_and_summary(make_evaluator, tmp_path):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3))
    write_results(tmp_path / "out", reply.records, summary_mapping(reply.summaries))
    lines = [json.loads(line) for line in (tmp_path / "out" / "episodes.jsonl").read_text().splitlines()]
    assert len(lines) == 18
    assert lines[0]["episode"] == "test-0-000000"
    assert lines[0]["human_distance_min_m"] is None
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["static"]["straight-line"]["success_rate"] == pytest.approx(2 / 3)
    assert summary["static"]["straight-line"]["static_collision_rate"] == pytest.approx(1 / 3)
    assert summary["static"]["expert"]["art_s"] == pytest.approx(5.0)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["episodes.jsonl", "summary.json"]


def test_table_shows_rates_and_interval(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3, tasks=(Task.STATIC,)))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(summary_table(reply.summaries))
    text = console.export_text()
    assert "straight-line" in text
    assert "66.7" in text
    assert np.all([name in text for name in ("SR %", "95 %", "ART s", "SPL", "late %")])


def test_results_are_read_as_they_were_written(make_evaluator, tmp_path):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1))
    write_results(tmp_path, reply.records, {"seed": 0})
    records, summary = read_results(tmp_path)
    assert [record.to_mapping() for record in records] == [record.to_mapping() for record in reply.records]
    assert [record.episode for record in records] == [record.episode for record in reply.records]
    assert summary == {"seed": 0}
