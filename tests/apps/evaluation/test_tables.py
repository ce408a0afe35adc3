from readygo.apps.evaluation.tables import comparisons_html, failures_html, latex, measures_html
from readygo.services.evaluator.scores import compare_all, failure_counts, scores_of
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
