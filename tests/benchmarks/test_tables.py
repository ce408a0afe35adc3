import json

import pytest

from readygo.benchmarks.tables import PAGE, README, RESULTS, leaderboard, main, page, readme, tables_of
from readygo.runs.benchmark.suite import open_suite


def score(mean, low, high, count=20):
    return {"mean": mean, "low": low, "high": high, "count": count}


MEASURES = {"dynamic": {"mesh": {"success": score(0.456, 0.2, 0.7), "art_s": score(12.3456, 10.0, 15.0)}}}
COMPARISON = {
    "task": "dynamic",
    "method": "mesh",
    "reference": "photoreal",
    "episodes": 20,
    "only_method": 2,
    "only_reference": 7,
    "mcnemar_p": 0.1796875,
}


def test_page_in_docs_is_what_the_results_say(request: pytest.FixtureRequest) -> None:
    text = page(RESULTS)
    if request.config.getoption("--update-golden"):
        main()
    assert PAGE.read_text() == text, "docs/tables.md is old: run `python -m readygo.benchmarks.tables`"
    assert README.read_text() == readme(README.read_text(), RESULTS), "so is README.md"
    assert "| `expert` | 100 (98 to 100) |" in README.read_text()


def test_rates_are_per_cent_with_their_intervals(tmp_path):
    kept = {"machine": {"cores": 2}, "command": "readygo evaluate x", "measures": MEASURES, "comparisons": [COMPARISON]}
    (tmp_path / "a.json").write_text(json.dumps(kept))
    (tmp_path / "b.json").write_text("[1]")
    (tmp_path / "c.json").write_text(json.dumps({"machine": {}, "rows": []}))
    text = page(tmp_path)
    assert "| pedestrian collision % | episodes | beside photoreal |\n" in text
    assert "| dynamic | mesh | 46 (20 to 70) | 12.35 (10.00 to 15.00) |  |  |  | 20 | +2 -7, p 0.18 |" in text
    assert "`benchmarks/results/a.json` (cores 2)" in text
    assert text.count("\n## ") == 1


def suite_results(**totals: float) -> dict[str, object]:
    """Results of drivers that reach half of the goals in one cell and all in another."""
    suite = open_suite("pedestrian-nav/1")
    measures = {name: {"spl": score(0.4, 0.3, 0.5), "compliance": score(0.9, 0.8, 1.0)} for name in totals}
    reached = {cell: {"success": score(mean, mean, mean)} for cell, mean in (("pedestrians-ignore", 0.5), ("empty", 1))}
    return {
        "suite_sha256": suite.sha256,
        "episodes": 20,
        "drivers": {
            name: {"inputs": {"images": ["rgb"], "trained_on": "flat" if name == "mine" else ""}} for name in totals
        },
        "cells": {
            cell: {name: {**measures[name], **success, "total": score(totals[name], 0, 1)} for name in totals}
            for cell, success in reached.items()
        },
    }


def test_leaderboard_joins_the_drivers_of_all_files_by_their_total():
    lines = leaderboard({"a.json": suite_results(weak=0.3, mine=0.7), "b.json": suite_results(other=0.5)})
    rows = [line for line in lines if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == ["mine", "other", "weak"]
    assert rows[0].startswith(
        "| `mine` | 0.70 (0.00 to 1.00) | 50 (50 to 50) | 0.40 (0.30 to 0.50) | 90 (80 to 100) | 75 |"
    )
    assert rows[0].endswith("| no | no | rgb | flat | none | 1 | 20 |")
    assert rows[1].endswith("| nothing | none |  | 20 |")
    assert "`benchmarks/results/a.json`, `benchmarks/results/b.json`" in "".join(lines)


def test_leaderboard_of_another_suite_is_refused_and_without_results_there_is_none():
    with pytest.raises(ValueError, match=r"a\.json is not of the suite pedestrian-nav/1"):
        leaderboard({"a.json": {**suite_results(mine=0.7), "suite_sha256": "ab"}})
    assert leaderboard({}) == []


def test_comparison_of_fewer_episodes_than_were_driven_says_so(tmp_path):
    kept = {"measures": MEASURES, "comparisons": [{**COMPARISON, "episodes": 13}]}
    (tmp_path / "a.json").write_text(json.dumps(kept))
    assert "| 20 | +2 -7 (of 13), p 0.18 |" in page(tmp_path)


def test_every_scene_of_a_comparison_has_a_table_and_what_is_no_rate_has_none():
    scenes = {scene: {"measures": MEASURES, "comparisons": []} for scene in ("embedded", "embedded:1")}
    assert [table.title for table in tables_of({"scenes": scenes})] == ["realism in embedded", "realism in embedded:1"]
    assert tables_of({"scenes": {"x": {"psnr": 3}}}) == tables_of({"scores": 3}) == []


def test_scores_of_runs_that_learned_are_read():
    scores = {
        "success_rate": 0.92,
        "success_rate_low": 0.85,
        "success_rate_high": 0.96,
        "episode_count": 100,
        "art_s": 9.5,
        "spl": 0.87,
        "static_collision_rate": 0.07,
        "human_collision_rate": 0.0,
    }
    (table,) = tables_of({"command": "c", "scores": {"static": {"policy": scores}}, "points": []})
    assert table.measures["static"]["policy"]["success"] == score(0.92, 0.85, 0.96, 100)
    assert table.measures["static"]["policy"]["static_collision"] == {"mean": 0.07}
