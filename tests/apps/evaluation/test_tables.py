import dataclasses
import math
from collections.abc import Callable

import pytest

from readygo.apps.evaluation.tables import comparisons_html, failures_html, latex, measures_html
from readygo.common.messages import Outcome
from readygo.services.evaluator import Task
from readygo.services.evaluator.scores import Score, compare_all, failure_counts, scores_of
from tests.services.evaluator.test_scores import RECORDS

SCORES = scores_of(RECORDS, time_limit_s=50.0)


def test_measures_have_a_column_per_method_and_their_intervals():
    html = measures_html(SCORES)
    assert html.index(">expert<") < html.index(">policy<")
    assert "<h3>Among humans</h3>" in html
    assert "<b>50</b> (15 to 85)" in html
    assert "Wilson" in html


def test_comparison_tells_test_and_ratios():
    html = comparisons_html(compare_all(RECORDS, "expert", time_limit_s=50.0))
    assert "0.500" in html
    assert "-50 %" in html
    assert comparisons_html([]) == ""


def test_failures_are_counted_by_kind_and_empty_without_any():
    html = failures_html(failure_counts(RECORDS))
    assert "Drove into a human in plain view" in html
    assert "Hit a thing" not in html
    assert failures_html(failure_counts(RECORDS[:4])) == ""


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
        dataclasses.replace(record, task=Task.STATIC, method="straight_line")
        for record in RECORDS
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
        measures_html(scores),
        measures_html({}),
        comparisons_html([empty, uneven]),
        failures_html(failure_counts(crooked)),
        latex(scores),
    ]
    golden_page("evaluation_tables", "\n\n".join(parts))
