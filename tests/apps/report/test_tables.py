import dataclasses
import math
from collections.abc import Callable

import pytest

from readygo.apps.report.tables import (
    DriverScore,
    comparison_tables,
    failure_tables,
    latex,
    measure_tables,
    success_rates,
)
from readygo.common.episode import TaskSummary
from readygo.common.messages import Outcome
from readygo.services.evaluator import Task
from readygo.services.evaluator.scores import Score, compare_all, failure_counts, scores_of
from tests.apps.report.drawn import html_of
from tests.services.evaluator.test_scores import RECORDS

SCORES = scores_of(RECORDS, time_limit_s=50.0)


def test_measures_have_a_column_per_method_and_their_intervals():
    html = html_of(measure_tables(SCORES))
    assert html.index(">expert<") < html.index(">policy<")
    assert "<h3>Among humans</h3>" in html
    assert "<b>50</b> <small>(15 to 85)</small>" in html
    assert "Wilson" in html


def test_comparison_tells_test_and_ratios():
    html = html_of(comparison_tables(compare_all(RECORDS, "expert", time_limit_s=50.0)))
    assert "0.500" in html
    assert "-50 %" in html
    assert comparison_tables([]) == []


def test_failures_are_counted_by_kind_and_empty_without_any():
    html = html_of(failure_tables(failure_counts(RECORDS)))
    assert "Drove into a human in plain view" in html
    assert "Hit a thing" not in html
    assert failure_tables(failure_counts(RECORDS[:4])) == []


def test_latex_is_a_table_with_a_row_per_method():
    text = latex(SCORES)
    assert text.startswith(r"\begin{tabular}{llrrrrrrr}")
    assert r"SR [\%]" in text
    rows = [line for line in text.splitlines() if line.startswith("dynamic")]
    assert [row.split(" & ")[1] for row in rows] == ["expert", "policy"]
    assert all(row.count("&") == 8 and row.endswith(r"\\") for row in rows)


@pytest.fixture
def crooked():
    """A task alone with one method, and one among humans with two."""
    alone = [
        dataclasses.replace(
            record,
            task=Task.STATIC,
            method="straight_line",
            episode=dataclasses.replace(record.episode, index=index),
        )
        for index, record in enumerate(RECORDS)
        if record.result.outcome is not Outcome.HUMAN_COLLISION
    ]
    return [*alone, *RECORDS]


def test_tables_look_as_they_did(crooked, golden_page: Callable[[str, str], None]):
    scores = scores_of(crooked, time_limit_s=43.0)
    unknown = {**scores[Task.STATIC, "straight_line"]}
    unknown["spl"] = dataclasses.replace(unknown["spl"], mean=math.nan, low=math.nan, high=math.nan)
    del unknown["art_s"]
    scores[Task.STATIC, "straight_line"] = unknown
    (compared,) = compare_all(RECORDS, "expert", time_limit_s=43.0)
    empty = dataclasses.replace(compared, time_ratio=dataclasses.replace(compared.time_ratio, mean=math.nan))
    uneven = dataclasses.replace(
        compared, only_method=3, only_reference=7, success_ratio=Score(mean=0.52, low=0.31, high=1.17, count=11)
    )
    parts = [
        html_of(measure_tables(scores)),
        html_of(comparison_tables([empty, uneven])),
        html_of(failure_tables(failure_counts(crooked))),
        latex(scores),
    ]
    assert measure_tables({}) == []
    golden_page("evaluation_tables", "\n\n".join(parts))


SUMMARY = TaskSummary(
    episode_count=1200,
    success_rate=0.25,
    success_rate_low=0.125,
    success_rate_high=0.5,
    art_s=12.34,
    spl=0.2,
    static_collision_rate=0.4,
    human_collision_rate=0.3,
    timeout_rate=0.05,
)


def scores() -> list[DriverScore]:
    return [
        DriverScore(task=task, driver=driver, summary=SUMMARY)
        for task in ("static", "<b>")
        for driver in ("policy", "me")
    ]


def test_every_task_has_its_bars_and_the_watched_driver_stands_out() -> None:
    html = html_of(success_rates(scores(), watched="me"))
    assert html.count("<h3>") == 2
    assert html.count('<div class="rates own"><span>me</span>') == 2
    assert html.count('<div class="rates"><span>policy</span>') == 2
    assert "&lt;b&gt;" in html


def test_all_numbers_are_there_and_the_note_is_no_markup() -> None:
    html = html_of(success_rates(scores(), note="Of <two> tasks."))
    for text in ("25 %", "12 % to 50 %", "12.3 s", "0.20", "30 %", "40 %", "5 %", "1,200", "Of &lt;two&gt; tasks."):
        assert text in html


def test_section_looks_as_it_did(golden_page: Callable[[str, str], None]) -> None:
    other = dataclasses.replace(SUMMARY, success_rate=0.62, success_rate_low=0.55, success_rate_high=0.71, art_s=9.96)
    shown = [
        DriverScore(task="static", driver="policy", summary=SUMMARY),
        DriverScore(task="among <humans>", driver="policy", summary=other),
        DriverScore(task="static", driver="<expert>", summary=other),
    ]
    golden_page("scores", html_of(success_rates(shown, note="And & more.")))
