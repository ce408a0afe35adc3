import json
import math
from pathlib import Path
from typing import Any

import pytest

from readygo.apps.sweep import results
from readygo.apps.sweep.folder import PointRecord, SweepFolder
from readygo.apps.sweep.plan import Sweep
from readygo.apps.sweep.results import join_results, mean_over_seeds, measured, sweep_rows
from readygo.common.errors import RunError
from tests.apps.sweep.sweeps import read_sweep


def _score(mean: float | None) -> dict[str, Any]:
    return {"mean": mean, "low": 0.0, "high": 1.0, "count": 9}


def _write(folder: SweepFolder, sweep: Sweep, index: int, success: float | None, **values: Any) -> PointRecord:
    result = {"measures": {"dynamic": {"expert": {"success": _score(success), "art_s": _score(20.0 + index)}}}}
    point = sweep.points[index]
    record = PointRecord(**{"name": point.name, "sha256": "a", "state": "done", "result": result, **values})
    folder.write(point, record)
    return record


def test_rows_are_means_over_the_seeds_of_an_arm_in_a_scene(tmp_path: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    pairs = [(sweep.points[k], _write(folder, sweep, k, value)) for k, value in enumerate((0.4, 0.6, 0.8))]
    first, second = sweep_rows(pairs)
    assert (first.arm, first.scene, first.part, first.seeds) == ("calm", "embedded", ("dynamic", "expert"), 2)
    assert first.scores["success"].mean == pytest.approx(0.5)
    assert (second.scene, second.seeds) == ("embedded-1", 1)
    assert math.isnan(second.scores["success"].low)


def test_interval_is_students() -> None:
    score = mean_over_seeds([1.0, 2.0, 3.0])
    assert (score.mean, score.count) == (2.0, 3)
    assert score.high - score.mean == pytest.approx(4.302653 / math.sqrt(3), rel=1e-5)
    assert mean_over_seeds([0.0, 1.0], share=True).low == 0.0
    assert mean_over_seeds([0.0, 1.0], share=True).high == 1.0
    assert mean_over_seeds([0.0, 1.0]).low == pytest.approx(0.5 - 12.7062 * 0.5, rel=1e-4)


def test_measures_of_all_commands_are_found() -> None:
    scores = {"both": {"mine/0": {"success": _score(0.5), "spl": _score(None)}, "expert": {"success": _score(1.0)}}}
    assert measured({"scores": scores}) == {("both", "mine"): {"success": 0.5}, ("both", "expert"): {"success": 1.0}}
    assert measured({"measures": scores, "scores": {"other": 1}}).keys() == {("both", "mine"), ("both", "expert")}
    tests = {"embedded": {"dynamic policy": 0.25}}
    assert measured({"test": tests, "minutes": 1}) == {("dynamic", "policy"): {"success": 0.25}}
    assert measured({"test": {**tests, "b": {"static expert": 1.0}}}) == {
        ("dynamic, embedded", "policy"): {"success": 0.25},
        ("static, b", "expert"): {"success": 1.0},
    }
    assert measured({"val_static": 0.5, "done": True, "policy": "x"}) == {("", ""): {"val_static": 0.5}}
    assert measured(None) == {}


def test_policies_of_several_seeds_in_one_point_have_their_mean() -> None:
    scores = {
        "both": {
            "mine/0": {"success": {"mean": 0.1}, "art_s": {"mean": None}},
            "expert": {"success": {"mean": 1.0}},
            "mine/1": {"success": {"mean": 0.9}, "art_s": {"mean": 8.0}},
        }
    }
    assert measured({"scores": scores}) == {
        ("both", "mine"): {"success": 0.5, "art_s": 8.0},
        ("both", "expert"): {"success": 1.0},
    }


def test_joined_results_are_json_markdown_and_a_page(tmp_path: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    _write(folder, sweep, 0, 0.4, commit="a")
    _write(folder, sweep, 1, 0.6, commit="b")
    _write(folder, sweep, 2, 0.8, state="failed", reason="no scene")
    _write(folder, sweep, 3, 0.8, state="running")
    with folder.lock(sweep.points[4], patience_s=0.0):
        _write(folder, sweep, 4, 0.8, state="running")
        states = [record.state for record in join_results(folder, sweep)]
    assert states == ["done", "done", "failed", "interrupted", "running"]
    joined = json.loads((folder.path / "sweep.json").read_text())
    assert joined["format"] == "readygo-sweep/1"
    assert joined["plan_sha256"] == sweep.sha256
    assert [(point["arm"], point["scene"], point["seed"], point["state"]) for point in joined["points"][:3]] == [
        ("calm", "embedded", 0, "done"), ("calm", "embedded", 1, "done"), ("calm", "embedded-1", 0, "failed"),
    ]  # fmt: skip
    (row,) = joined["rows"]
    assert row["scores"]["success"]["mean"] == pytest.approx(0.5)
    markdown = (folder.path / "sweep.md").read_text()
    assert "2 of 8 points are done (arms 2, scenes 2, seeds 2). They are of 2 commits: a, b." in markdown
    assert "| calm | embedded | dynamic | expert | 2 | 50 (0 to 100) | 20.5 (14.1 to 26.9) |" in markdown
    assert "calm" in (folder.path / "sweep.html").read_text()


def test_single_seed_has_no_interval_and_large_numbers_are_whole(tmp_path: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    _write(folder, sweep, 0, None, result={"val_static": 0.25, "decisions": 40960.0, "ratio_v": 0.12345})
    join_results(folder, sweep)
    markdown = (folder.path / "sweep.md").read_text()
    assert "| calm | embedded | 1 | 25 | 40,960 | 0.123 |" in markdown
    row = json.loads((folder.path / "sweep.json").read_text())["rows"][0]
    assert row["scores"]["val_static"]["low"] is None


def test_nothing_done_is_a_page_without_a_table(tmp_path: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    assert join_results(folder, sweep) == []
    assert "0 of 8 points are done" in (folder.path / "sweep.md").read_text()


def test_two_processes_do_not_join_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    monkeypatch.setattr(results, "JOIN_S", 0.0)
    with folder.lock_all(patience_s=0.0), pytest.raises(RunError, match="Another process has joined"):
        join_results(folder, sweep)
