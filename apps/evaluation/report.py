"""The web pages of an evaluation: scores of all methods, and a gallery of failures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from readygo.apps.evaluation.choice import FAILURES
from readygo.apps.evaluation.replay import StripImage
from readygo.apps.evaluation.tables import TASK_NAMES
from readygo.apps.pages.page import figure, jpeg_source, legend, page, percent, png_source
from readygo.apps.pages.scores import Score, scores_section
from readygo.common.drawing import plan_view
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import GOAL, HUMANS, INK, ROBOT, Rgb
from readygo.common.episode.metrics import TaskSummary
from readygo.common.maps import OccupancyMap
from readygo.common.messages import Outcome, RobotTrajectory
from readygo.services.evaluator import EpisodeRecord, Task, short_name

REPORT_FILE, GALLERY_FILE = "report.html", "failures.html"
_MAP_HEIGHT_PX = 760
WORDS = {Outcome.SUCCESS: "reached the goal", **FAILURES}
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
    picture: Picture
    """The map with the trajectories of robot and humans."""
    strip: Sequence[StripImage]
    film: Path | None = None
    """Path of its video, in the page's folder; None without one."""
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
    tables: Mapping[str, str] = field(default_factory=dict)
    """HTML of the tables of module `tables`, by heading."""
    facts: Mapping[str, str] = field(default_factory=dict)


def report_html(content: EvaluationContent) -> str:
    """The page of the whole evaluation."""
    scores = [(key, summary) for key, summary in content.summaries.items() if key[1] == content.watched]
    tiles = [(percent(summary.success_rate), f"success, {TASK_NAMES[task]}") for (task, _), summary in scores]
    counts = {summary.episode_count for summary in content.summaries.values()}
    return page(
        content.title,
        f"{_name(content.watched)} among others in the same {max(counts)} episodes of each task, in closed loop.",
        tiles=[*tiles, (str(content.failure_count), "failures to look at")],
        sections=[
            ("Results", _scores(content.summaries, content.watched)),
            *content.tables.items(),
            ("Where it went", _ways(content)),
            ("What it fails in", _failure_counts(content)),
            ("Films", _films(content.films)),
        ],
        facts=content.facts,
    )


def gallery_html(content: EvaluationContent) -> str:
    """The page of the failures, grouped by kind."""
    groups: dict[tuple[Task, Outcome], list[Failure]] = {}
    for failure in content.failures:
        groups.setdefault((failure.record.task, failure.record.result.outcome), []).append(failure)
    shown = len(content.failures)
    more = f"{shown} of {content.failure_count}, the worst first" if shown < content.failure_count else f"all {shown}"
    return page(
        f"Failures: {content.title}",
        f"{_name(content.watched)}'s failures, {more}. The map shows everybody's way until the end, a dot a second; "
        "the images are what the robot saw.",
        tiles=[(str(len(group)), _kind(task, outcome)) for (task, outcome), group in groups.items()],
        sections=[
            (_kind(task, outcome).capitalize(), "".join(map(_failure, group)))
            for (task, outcome), group in groups.items()
        ],
        facts=content.facts,
    )


def draw_runs(occupancy: OccupancyMap, runs: Sequence[tuple[EpisodeRecord, RobotTrajectory]]) -> Picture:
    """Paths of many episodes on the whole map; the colour of a dot shows how each ended."""
    view = plan_view.resized(plan_view.map_view(occupancy), _MAP_HEIGHT_PX)
    picture = view.rgb.copy()
    for _, trajectory in runs:
        plan_view.draw_path(picture, view, trajectory.xyyaw[:, :2], ROBOT, width_px=2)
    for record, trajectory in runs:
        plan_view.draw_disc(picture, view, trajectory.xyyaw[-1, :2], 0.14, _END_COLOURS[record.result.outcome])
    plan_view.draw_scale_bar(picture, view)
    return picture


def _scores(summaries: Mapping[tuple[Task, str], TaskSummary], watched: str) -> str:
    scores = [
        Score(task=TASK_NAMES[task], driver=short_name(method), summary=summary)
        for (task, method), summary in summaries.items()
    ]
    return scores_section(scores, watched=short_name(watched))


def _ways(content: EvaluationContent) -> str:
    if not content.runs:
        return ""
    ends = Counter(record.result.outcome for record, _ in content.runs)
    picture = figure(
        png_source(draw_runs(content.occupancy, content.runs)),
        f"{len(content.runs)} episodes of the {content.watched}, each with a dot where it ended.",
        alt="Map with the ways of all episodes",
    )
    return picture + legend([(f"{WORDS[kind]}: {ends[kind]}", colour) for kind, colour in _END_COLOURS.items()])


def _failure_counts(content: EvaluationContent) -> str:
    if not content.failure_count:
        return "<p>No episode failed.</p>"
    return f'<p><a href="{GALLERY_FILE}">The failures, kind by kind, with maps and what the robot saw</a></p>'


def _films(films: Sequence[tuple[EpisodeRecord, Path]]) -> str:
    return "".join(
        f'<figure class="film">{_video(path)}<figcaption>{escape(_headline(record))}</figcaption></figure>'
        for record, path in films
    )


def _failure(failure: Failure) -> str:
    record = failure.record
    near = record.human_distance_min_m
    facts = [f"{failure.goal_distance_m:.1f} m from the goal"]
    facts += [f"humans came as near as {near:.2f} m"] if near < float("inf") else []
    facts += _why(record)
    images = "".join(
        figure(jpeg_source(image.rgb), f"{image.time_s:.2f} s", alt=f"Robot's view after {image.time_s:.2f} s")
        for image in failure.strip
    )
    caption = f"{_headline(record)}, {', '.join(facts)}."
    picture = figure(png_source(failure.picture), caption, alt="Map with everybody's ways")
    command = f"<pre><code>{escape(failure.command)}</code></pre>" if failure.command else ""
    film = f'<div class="film">{_video(failure.film)}</div>' if failure.film else ""
    return f'<div class="pair film">{picture}<div class="strip">{images}</div></div>{film}{command}'


def _video(path: Path) -> str:
    source = escape(f"{path.parent.name}/{path.name}")
    return f'<video controls muted playsinline preload="metadata" src="{source}"></video>'


def _headline(record: EpisodeRecord) -> str:
    what = WORDS[record.result.outcome]
    return f"Episode {record.episode.index} {TASK_NAMES[record.task]}: {what} after {record.result.duration_s:.2f} s"


def _why(record: EpisodeRecord) -> list[str]:
    """Lines that explain the failure of an episode."""
    said = [record.category.value] if record.category else []
    contact = record.result.conduct.contact if record.result.conduct else None
    if contact is not None:
        said.append(f"seen for {contact.seen_s:.1f} s before, {'in view' if contact.in_view else 'out of view'} then")
    return [*said, *([record.reason] if record.reason else [])]


def _kind(task: Task, outcome: Outcome) -> str:
    if outcome is Outcome.HUMAN_COLLISION and task is Task.DYNAMIC:
        return FAILURES[outcome]
    return f"{FAILURES[outcome]}, {TASK_NAMES[task]}"


def _name(method: str) -> str:
    return f"The {method.replace('-', ' ')}"
