"""The tables of an evaluation, in HTML and LaTeX: all measures, comparisons of methods, kinds of failure."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

from readygo.apps.pages.page import Column, table
from readygo.services.evaluator import Category, Task, short_name
from readygo.services.evaluator.scores import MEASURES, Comparison, Group, Measure, Score

TASK_NAMES = {Task.STATIC: "alone", Task.DYNAMIC: "among humans", Task.REACTIVE: "among humans who make way"}
LATEX_MEASURES = ("success", "art_s", "spl", "static_collision", "human_collision", "at_fault", "intrusion")
_LATEX_SPECIAL = str.maketrans({"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#"})
_NOTE = (
    "In brackets: 95 % intervals, Wilson's of rates, else of 2,000 resamples of the episodes. Robot's fault: it drove "
    "into a human that its camera had shown for 1 s or longer. Personal space: share of the time within 0.5 m of "
    "a human's side. Near misses: encounters within 0.2 m, per episode. Jerk: root mean square of the speed's "
    "second derivative; turn acceleration: mean change of the turn rate."
)


def measures_html(scores: Mapping[Group, Mapping[str, Score]]) -> str:
    """HTML tables with every measure of every method, one per task."""
    tables = "".join(
        f"<h3>{escape(TASK_NAMES[task].capitalize())}</h3>{_of_task(task, scores)}" for task in _tasks(scores)
    )
    return f'{tables}<p class="note">{escape(_NOTE)}</p>' if tables else ""


def comparisons_html(comparisons: Sequence[Comparison]) -> str:
    """HTML table of paired comparisons of methods on the same episodes."""
    if not comparisons:
        return ""
    columns = (
        Column("Task"),
        Column("Method"),
        Column("beside"),
        Column("Episodes", "n"),
        Column("Only it succeeds", "n"),
        Column("Only the other", "n"),
        Column("McNemar's p", "n"),
        Column("Difference of SR", "n"),
        Column("Ratio of SR", "n"),
        Column("Ratio of times", "n"),
    )
    return table(columns, [_comparison_cells(comparison) for comparison in comparisons])


def failures_html(counts: Mapping[Group, Counter[Category]]) -> str:
    """HTML table of failure counts by method and kind."""
    kinds = [kind for kind in Category if any(kind in of_group for of_group in counts.values())]
    if not kinds:
        return ""
    columns = (Column("Task"), Column("Method"), *(Column(kind.value.capitalize(), "n") for kind in kinds))
    rows = [
        [escape(TASK_NAMES[task]), escape(short_name(method)), *(str(of_group[kind] or "") for kind in kinds)]
        for (task, method), of_group in counts.items()
    ]
    return table(columns, rows)


def latex(scores: Mapping[Group, Mapping[str, Score]]) -> str:
    """LaTeX table for a paper, with the package booktabs: a row per task and method."""
    measures = [measure for measure in MEASURES if measure.name in LATEX_MEASURES]
    heads = [_title(measure) for measure in measures]
    lines = [
        rf"\begin{{tabular}}{{ll{'r' * len(measures)}}}",
        r"\toprule",
        " & ".join(["Task", "Method", *(head.translate(_LATEX_SPECIAL) for head in heads)]) + r" \\",
    ]
    for task in _tasks(scores):
        lines.append(r"\midrule")
        for (of_task, method), by_name in scores.items():
            if of_task is task:
                cells = [_latex_cell(measure, by_name.get(measure.name)) for measure in measures]
                lines.append(" & ".join([task.value, short_name(method).translate(_LATEX_SPECIAL), *cells]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _tasks(scores: Mapping[Group, Mapping[str, Score]]) -> list[Task]:
    return list(dict.fromkeys(task for task, _ in scores))


def _of_task(task: Task, scores: Mapping[Group, Mapping[str, Score]]) -> str:
    """HTML table of one task: measures as rows, methods as columns."""
    methods = [method for of_task, method in scores if of_task is task]
    measures = [measure for measure in MEASURES if any(measure.name in scores[task, method] for method in methods)]
    columns = (Column("Measure"), *(Column(short_name(method), "n") for method in methods))
    rows = [
        [escape(_title(measure)), *(_cell(measure, scores[task, method].get(measure.name)) for method in methods)]
        for measure in measures
    ]
    return table(columns, rows)


def _cell(measure: Measure, score: Score | None) -> str:
    if score is None:
        return ""
    low, high = (_number(measure, value) for value in (score.low, score.high))
    return f"<b>{_number(measure, score.mean)}</b> ({low} to {high})"


def _latex_cell(measure: Measure, score: Score | None) -> str:
    if score is None:
        return "--"
    low, high = (_number(measure, value) for value in (score.low, score.high))
    return f"{_number(measure, score.mean)} ({low}--{high})"


def _number(measure: Measure, value: float) -> str:
    if math.isnan(value):
        return "?"
    return (
        f"{100 * value:.0f}"
        if measure.unit.startswith("%")
        else f"{value:.1f}"
        if measure.unit == "s"
        else f"{value:.2f}"
    )


def _title(measure: Measure) -> str:
    return f"{measure.title} [{measure.unit}]" if measure.unit else measure.title


def _comparison_cells(comparison: Comparison) -> list[str]:
    success = comparison.differences["success"]
    return [
        escape(TASK_NAMES[comparison.task]),
        escape(short_name(comparison.method)),
        escape(short_name(comparison.reference)),
        str(comparison.episodes),
        str(comparison.only_method),
        str(comparison.only_reference),
        f"{comparison.mcnemar_p:.3f}",
        f"<b>{100 * success.mean:+.0f} %</b> ({100 * success.low:+.0f} to {100 * success.high:+.0f})",
        _ratio(comparison.success_ratio),
        _ratio(comparison.time_ratio),
    ]


def _ratio(score: Score) -> str:
    if math.isnan(score.mean):
        return ""
    return f"<b>{score.mean:.2f}</b> ({score.low:.2f} to {score.high:.2f})"
