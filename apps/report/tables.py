"""Tables of success rates, for pages and in LaTeX: bars by task, all measures, comparisons, kinds of failure."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from readygo.apps.report.page import (
    Block,
    Details,
    Estimate,
    Meter,
    PageTable,
    RateRow,
    Subheading,
    percent,
    small_print,
)
from readygo.common.episode import TaskSummary
from readygo.services.evaluator import MEASURES, Category, Comparison, Group, Measure, Score, Task, short_name

TASK_NAMES = {Task.STATIC: "alone", Task.DYNAMIC: "among humans", Task.REACTIVE: "among humans who make way"}
LATEX_MEASURES = ("success", "art_s", "spl", "static_collision", "human_collision", "at_fault", "intrusion")
_LATEX_SPECIAL = str.maketrans({"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#"})
_SUMMARY_COLUMNS = (
    *("Task", "Driver", "Success", "95 % interval", "Reaching time", "SPL"),
    *("Hit a human", "Hit a thing", "Too late", "Episodes"),
)
_SUMMARY_NOTE = (
    "Success: within the goal's circle, no collision, in time. The line on a bar is Wilson's 95 % interval. The "
    "reaching time is the mean over all episodes, a failed one counting as the time limit; SPL is success weighted by "
    "path length. "
)
_MEASURES_NOTE = (
    "In brackets: 95 % intervals, Wilson's of rates, else of 2,000 resamples of the episodes. Robot's fault: it drove "
    "into a human that its camera had shown for 1 s or longer. Personal space: share of the time within 0.5 m of "
    "a human's side. Near misses: encounters within 0.2 m, per episode. Jerk: root mean square of the speed's "
    "second derivative; turn acceleration: mean change of the turn rate."
)
_UNSEEN = "The people of the test do not walk in the data."
_SEEN = (
    "People of the test, or variants of them, walk in the data: people who were not seen there may be harder. With "
    "eight avatars or more, a quarter is kept for the test."
)
_COMPARISON_COLUMNS = (
    *("Task", "Method", "Reference", "Episodes", "Only it succeeds", "Only the other"),
    *("McNemar's p", "Difference of SR", "Ratio of SR", "Ratio of times"),
)


@dataclass(frozen=True, kw_only=True)
class DriverScore:
    """Score of one driver in one task."""

    task: str
    """Name of the task, for example "static" or "among humans"."""
    driver: str
    """Name of the driver: "policy", "expert", "straight line"."""
    summary: TaskSummary


def people_note(*, unseen: bool) -> str:
    """Whether the people of a run's test walk in its data, in a sentence or two."""
    return _UNSEEN if unseen else _SEEN


def success_rates(scores: Sequence[DriverScore], *, watched: str = "policy", note: str = "") -> list[Block]:
    """Bars of success by task, and a table of all numbers.

    Args:
        scores: Scores in display order.
        watched: The driver that the page is about.
        note: Further text about the numbers.
    """
    blocks: list[Block] = []
    for task in dict.fromkeys(score.task for score in scores):
        blocks.append(Subheading(task.capitalize()))
        for score in scores:
            if score.task == task:
                s = score.summary
                meter = Meter(s.success_rate, (s.success_rate_low, s.success_rate_high))
                blocks.append(RateRow(name=score.driver, meter=meter, stands_out=score.driver == watched))
    numbers = PageTable(_SUMMARY_COLUMNS, [_summary_cells(score) for score in scores], text_columns=2)
    return [
        *blocks,
        small_print(_SUMMARY_NOTE + note),
        Details(summary="All numbers", block=numbers),
    ]


def measure_tables(scores: Mapping[Group, Mapping[str, Score]]) -> list[Block]:
    """Every measure of every method, a table per task; an empty list without scores."""
    blocks: list[Block] = []
    for task in _tasks(scores):
        blocks += [Subheading(TASK_NAMES[task].capitalize()), _measure_table(task, scores)]
    return [*blocks, small_print(_MEASURES_NOTE)] if blocks else []


def comparison_tables(comparisons: Sequence[Comparison]) -> list[Block]:
    """A table of paired comparisons of methods on the same episodes; an empty list without any."""
    rows = [_comparison_cells(comparison) for comparison in comparisons]
    return [PageTable(_COMPARISON_COLUMNS, rows, text_columns=3)] if rows else []


def failure_tables(counts: Mapping[Group, Counter[Category]]) -> list[Block]:
    """A table of failure counts by method and kind; an empty list without failures."""
    kinds = [kind for kind in Category if any(kind in of_group for of_group in counts.values())]
    columns = ("Task", "Method", *(kind.value.capitalize() for kind in kinds))
    rows = [
        [TASK_NAMES[task], short_name(method), *(str(of_group[kind] or "") for kind in kinds)]
        for (task, method), of_group in counts.items()
    ]
    return [PageTable(columns, rows, text_columns=2)] if kinds else []


def latex(scores: Mapping[Group, Mapping[str, Score]]) -> str:
    """LaTeX table for a paper, with the package booktabs: a row per task and method."""
    measures = [measure for measure in MEASURES if measure.name in LATEX_MEASURES]
    heads = [measure_title(measure) for measure in measures]
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


def _summary_cells(score: DriverScore) -> list[str | Block]:
    s = score.summary
    return [
        score.task,
        score.driver,
        Estimate(percent(s.success_rate)),
        f"{percent(s.success_rate_low)} to {percent(s.success_rate_high)}",
        f"{s.art_s:.1f} s",
        f"{s.spl:.2f}",
        percent(s.human_collision_rate),
        percent(s.static_collision_rate),
        percent(s.timeout_rate),
        f"{s.episode_count:,}",
    ]


def _tasks(scores: Mapping[Group, Mapping[str, Score]]) -> list[Task]:
    return list(dict.fromkeys(task for task, _ in scores))


def _measure_table(task: Task, scores: Mapping[Group, Mapping[str, Score]]) -> PageTable:
    """The table of one task: measures as rows, methods as columns."""
    methods = [method for of_task, method in scores if of_task is task]
    measures = [measure for measure in MEASURES if any(measure.name in scores[task, method] for method in methods)]
    columns = ("Measure", *map(short_name, methods))
    rows = [
        [measure_title(measure), *(measure_cell(measure, scores[task, method].get(measure.name)) for method in methods)]
        for measure in measures
    ]
    return PageTable(columns, rows)


def measure_cell(measure: Measure, score: Score | None) -> str | Block:
    """The cell of a table for a measure: its mean with the interval; empty without a score."""
    if score is None:
        return ""
    low, high = (_number(measure, value) for value in (score.low, score.high))
    return Estimate(_number(measure, score.mean), f"{low} to {high}")


def _latex_cell(measure: Measure, score: Score | None) -> str:
    if score is None:
        return "--"
    low, high = (_number(measure, value) for value in (score.low, score.high))
    return f"{_number(measure, score.mean)} ({low}--{high})"


def _number(measure: Measure, value: float) -> str:
    if math.isnan(value):
        return "?"
    if measure.unit.startswith("%"):
        return f"{100 * value:.0f}"
    return f"{value:.1f}" if measure.unit == "s" else f"{value:.2f}"


def measure_title(measure: Measure) -> str:
    """The title of a measure with its unit."""
    return f"{measure.title} [{measure.unit}]" if measure.unit else measure.title


def _comparison_cells(comparison: Comparison) -> list[str | Block]:
    success = comparison.differences["success"]
    return [
        TASK_NAMES[comparison.task],
        short_name(comparison.method),
        short_name(comparison.reference),
        str(comparison.episodes),
        str(comparison.only_method),
        str(comparison.only_reference),
        f"{comparison.mcnemar_p:.3f}",
        Estimate(f"{100 * success.mean:+.0f} %", f"{100 * success.low:+.0f} to {100 * success.high:+.0f}"),
        _ratio(comparison.success_ratio),
        _ratio(comparison.time_ratio),
    ]


def _ratio(score: Score) -> str | Block:
    return "" if math.isnan(score.mean) else Estimate(f"{score.mean:.2f}", f"{score.low:.2f} to {score.high:.2f}")
