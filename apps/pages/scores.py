"""Scores of drivers on a page: bars with intervals, and all numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from readygo.apps.pages.charts import meter
from readygo.apps.pages.page import Column, details, percent, table
from readygo.common.episode import TaskSummary

_COLUMNS = (
    Column("Task"),
    Column("Driver"),
    Column("Success", "n"),
    Column("95 % interval", "n"),
    Column("Reaching time", "n"),
    Column("SPL", "n"),
    Column("Hit a human", "n"),
    Column("Hit a thing", "n"),
    Column("Too late", "n"),
    Column("Episodes", "n"),
)
_NOTE = (
    "Success: within the goal's circle, no collision, in time. The line on a bar is Wilson's 95 % interval. The "
    "reaching time is the mean over all episodes, a failed one counting as the time limit; SPL is success weighted by "
    "path length. "
)


@dataclass(frozen=True, kw_only=True)
class Score:
    """Score of one driver in one task."""

    task: str
    """Name of the task, for example "static" or "among humans"."""
    driver: str
    """Name of the driver: "policy", "expert", "straight line"."""
    summary: TaskSummary


def scores_section(scores: Sequence[Score], *, watched: str = "policy", note: str = "") -> str:
    """Bars of success by task, and a table of everything.

    Args:
        scores: Scores in display order.
        watched: The driver that the page is about.
        note: Further text about the numbers.
    """
    bars = "".join(_bars(task, scores, watched) for task in dict.fromkeys(score.task for score in scores))
    numbers = details("All numbers", table(_COLUMNS, [_cells(score) for score in scores]))
    return f'{bars}<p class="note">{escape(_NOTE + note)}</p>{numbers}'


def _bars(task: str, scores: Sequence[Score], watched: str) -> str:
    return f"<h3>{escape(task.capitalize())}</h3>" + "".join(
        f'<div class="rates{" own" if score.driver == watched else ""}"><span>{escape(score.driver)}</span>'
        f"{meter(score.summary.success_rate, score.summary.success_rate_low, score.summary.success_rate_high)}"
        f"<b>{percent(score.summary.success_rate)}</b></div>"
        for score in scores
        if score.task == task
    )


def _cells(score: Score) -> list[str]:
    s = score.summary
    return [
        escape(score.task),
        escape(score.driver),
        f"<b>{percent(s.success_rate)}</b>",
        f"{percent(s.success_rate_low)} to {percent(s.success_rate_high)}",
        f"{s.art_s:.1f} s",
        f"{s.spl:.2f}",
        percent(s.human_collision_rate),
        percent(s.static_collision_rate),
        percent(s.timeout_rate),
        f"{s.episode_count:,}",
    ]
