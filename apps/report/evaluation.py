"""The web pages of an evaluation: scores of all methods, and a gallery of failures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from readygo.apps.report.page import (
    Arrangement,
    Block,
    ColourLegend,
    CommandLine,
    MediaFigure,
    PageLink,
    Paragraph,
    StripImage,
    drawing,
    image_strip,
    page,
    percent,
)
from readygo.apps.report.tables import TASK_NAMES, DriverScore, success_rates
from readygo.common.arrays import UInt8Array
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import GOAL, HUMANS, INK, ROBOT, Rgb
from readygo.common.episode.metrics import TaskSummary
from readygo.common.maps import OccupancyMap
from readygo.common.messages import Outcome, RobotTrajectory
from readygo.services.evaluator import EpisodeRecord, Task, short_name

REPORT_FILE, GALLERY_FILE = "report.html", "failures.html"
FAILURES = {
    Outcome.HUMAN_COLLISION: "hit a human",
    Outcome.STATIC_COLLISION: "hit a thing",
    Outcome.TIMEOUT: "too late",
}
"""Failed outcomes in words, the worst first."""
WORDS = {Outcome.SUCCESS: "reached the goal", **FAILURES}
_MAP_HEIGHT_PX = 760
_END_COLOURS: Mapping[Outcome, Rgb] = {
    Outcome.SUCCESS: GOAL,
    Outcome.HUMAN_COLLISION: HUMANS[0],
    Outcome.STATIC_COLLISION: INK,
    Outcome.TIMEOUT: HUMANS[1],
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Failure:
    """One failed episode of the gallery."""

    record: EpisodeRecord
    goal_distance_m: float
    """Distance to the goal at the end [m]."""
    picture: UInt8Array
    """The map with the trajectories of robot and humans."""
    strip: Sequence[StripImage]
    film: Path | None = None
    """Path of its video, in a folder beside the page; None without one."""
    command: str = ""
    """Command line that replays the episode."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationContent:
    """Content of the pages."""

    title: str
    watched: str
    """Method whose runs are shown."""
    summaries: Mapping[tuple[Task, str], TaskSummary]
    occupancy: OccupancyMap
    runs: Sequence[tuple[EpisodeRecord, RobotTrajectory]]
    """Episodes and trajectories that are drawn on the map."""
    failure_count: int
    """Number of all failures of the watched method, shown or not."""
    failures: Sequence[Failure]
    films: Sequence[tuple[EpisodeRecord, Path]]
    tables: Mapping[str, Sequence[Block]] = field(default_factory=dict)
    """Tables of module `tables`, by heading."""
    facts: Mapping[str, str] = field(default_factory=dict)


def report_html(content: EvaluationContent) -> str:
    """The page of the whole evaluation."""
    scores = [
        DriverScore(task=TASK_NAMES[task], driver=short_name(method), summary=summary)
        for (task, method), summary in content.summaries.items()
    ]
    watched = short_name(content.watched)
    tiles = [(percent(s.summary.success_rate), f"success, {s.task}") for s in scores if s.driver == watched]
    most = max((summary.episode_count for summary in content.summaries.values()), default=0)
    gallery = PageLink(href=GALLERY_FILE, what="The failures by kind, with maps and what the robot saw")
    failures = Paragraph(text="", links=[gallery]) if content.failure_count else Paragraph(text="No episode failed.")
    return page(
        content.title,
        f"{_name(content.watched)} among others in the same {most} episodes of each task, in closed loop.",
        tiles=[*tiles, (str(content.failure_count), "failures to look at")],
        sections={
            "Results": success_rates(scores, watched=watched),
            **content.tables,
            "Where it went": _runs(content),
            "What it fails in": [failures],
            "Videos": [_video(path, _headline(record)) for record, path in content.films],
        },
        facts=content.facts,
    )


def gallery_html(content: EvaluationContent) -> str:
    """The page of the failures, grouped by kind."""
    groups: dict[str, list[Failure]] = {}
    for failure in content.failures:
        groups.setdefault(_kind(failure.record), []).append(failure)
    shown = len(content.failures)
    more = f"{shown} of {content.failure_count}, the worst first" if shown < content.failure_count else f"all {shown}"
    return page(
        f"Failures: {content.title}",
        f"{_name(content.watched)}'s failures, {more}. The map shows all paths until the end, a dot a second; "
        "the images are what the robot saw.",
        tiles=[(str(len(group)), kind) for kind, group in groups.items()],
        sections={
            kind.capitalize(): [block for failure in group for block in _failure(failure)]
            for kind, group in groups.items()
        },
        facts=content.facts,
    )


def draw_runs(occupancy: OccupancyMap, runs: Sequence[tuple[EpisodeRecord, RobotTrajectory]]) -> UInt8Array:
    """Paths of many episodes on the whole map; the colour of a dot shows how each ended."""
    view = plan_view.resize_view(plan_view.map_view(occupancy), _MAP_HEIGHT_PX)
    picture = view.rgb.copy()
    for _, trajectory in runs:
        plan_view.draw_path(picture, view, trajectory.xyyaw[:, :2], ROBOT, width_px=2)
    for record, trajectory in runs:
        plan_view.draw_disc(picture, view, trajectory.xyyaw[-1, :2], 0.14, _END_COLOURS[record.result.outcome])
    plan_view.draw_scale_bar(picture, view)
    return picture


def _runs(content: EvaluationContent) -> list[Block]:
    if not content.runs:
        return []
    ends = Counter(record.result.outcome for record, _ in content.runs)
    caption = f"{len(content.runs)} episodes of the {content.watched}, each with a dot where it ended."
    return [
        drawing(draw_runs(content.occupancy, content.runs), caption, alt="Map with the paths of all episodes"),
        ColourLegend([(f"{WORDS[kind]}: {ends[kind]}", colour) for kind, colour in _END_COLOURS.items()]),
    ]


def _failure(failure: Failure) -> list[Block]:
    record, near_m = failure.record, failure.record.human_distance_min_m
    facts = [f"{failure.goal_distance_m:.1f} m from the goal"]
    facts += [f"humans came as near as {near_m:.2f} m"] if near_m < float("inf") else []
    facts += _reasons(record)
    caption = f"{_headline(record)}, {', '.join(facts)}."
    picture = drawing(failure.picture, caption, alt="Map with all paths")
    blocks: list[Block] = [Arrangement(kind="pair", blocks=[picture, *image_strip(failure.strip)])]
    blocks += [_video(failure.film, "")] if failure.film else []
    return [*blocks, CommandLine(line=failure.command)] if failure.command else blocks


def _video(path: Path, caption: str) -> MediaFigure:
    return MediaFigure(video=f"{path.parent.name}/{path.name}", caption=caption)


def _headline(record: EpisodeRecord) -> str:
    what = WORDS[record.result.outcome]
    return f"Episode {record.episode.index} {TASK_NAMES[record.task]}: {what} after {record.result.duration_s:.2f} s"


def _reasons(record: EpisodeRecord) -> list[str]:
    """Words that explain the failure of an episode."""
    words = [record.category.value] if record.category else []
    contact = record.result.conduct.contact if record.result.conduct else None
    if contact is not None:
        words.append(f"seen for {contact.seen_s:.1f} s before, {'in view' if contact.in_view else 'out of view'} then")
    return [*words, *([record.reason] if record.reason else [])]


def _kind(record: EpisodeRecord) -> str:
    """Kind of failure, and its task unless the kind implies it."""
    outcome = record.result.outcome
    if outcome is Outcome.HUMAN_COLLISION and record.task is Task.DYNAMIC:
        return FAILURES[outcome]
    return f"{FAILURES[outcome]}, {TASK_NAMES[record.task]}"


def _name(method: str) -> str:
    return f"The {method.replace('-', ' ')}"
