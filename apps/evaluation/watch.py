"""From what an evaluation kept to films and pages."""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from readygo.apps.evaluation.choice import FAILURES, badness, filmed, watched_method
from readygo.apps.evaluation.replay import Replays
from readygo.apps.evaluation.report import (
    GALLERY_FILE,
    REPORT_FILE,
    EvaluationContent,
    Failure,
    gallery_html,
    report_html,
)
from readygo.apps.evaluation.tables import comparisons_html, failures_html, latex, measures_html
from readygo.apps.run.evaluation import references
from readygo.common.files import write_whole
from readygo.common.messages import RobotTrajectory
from readygo.services.evaluator import EXPERT, POLICY, EpisodeRecord, EvaluateReply, EvaluateRequest, Task, short_name
from readygo.services.evaluator.scores import compare_all, failure_counts, scores_of

LATEX_FILE = "table.tex"
FILMS_FOLDER, FILM_ENDING = "films", ".webm"
SHOWN_MAX = 24
"""Failures on a page."""

CommandOf = Callable[[EpisodeRecord], str]
"""The command line that shows more of an episode."""


def write_films(replays: Replays, request: EvaluateRequest, reply: EvaluateReply, wanted: Sequence[str]) -> None:
    """Write the films that are wanted and not there yet.

    Args:
        replays: Of the evaluation.
        request: What was asked for.
        reply: How it went.
        wanted: See `filmed`.

    Raises:
        RunError: If an episode that is wanted was not driven.
        ReadygoError: If a film cannot be written.
    """
    for record in replays.load(filmed(_watched(request, reply), wanted)):
        path = film_path(replays.folder, record)
        if not path.exists():
            replays.film(path, record)


def write_pages(
    replays: Replays,
    request: EvaluateRequest,
    reply: EvaluateReply,
    *,
    title: str,
    command_of: CommandOf | None = None,
) -> None:
    """Write the report and, if anything failed, the gallery of failures, with the films that are there.

    Args:
        replays: Of the evaluation.
        request: What was asked for.
        reply: How it went.
        title: Who drove, and where.
        command_of: Told with each failure.

    Raises:
        ReadygoError: If they cannot be written.
    """
    records, folder, scene = _watched(request, reply), replays.folder, replays.world.scene
    runs = {record.key: (record, replays.trajectory(record)) for record in replays.load(records)}
    failed = sorted((record for record in records if record.result.outcome in FAILURES), key=badness)
    chosen = [runs[record.key] for record in shown(failed) if record.key in runs]
    content = EvaluationContent(
        title=title,
        watched=watched_method(request.methods),
        summaries=reply.summaries,
        occupancy=scene.maps.robot,
        runs=list(runs.values()),
        failure_count=len(failed),
        failures=[_failure(replays, record, run, command_of) for record, run in chosen],
        tables=_tables(reply, request, replays.world.config.episode.time_limit_s),
        films=[(record, film_path(folder, record)) for record in records if film_path(folder, record).exists()],
        facts={
            "scene": f"{scene.name} {scene.content_hash[:12]}",
            "episodes": f"split {request.split.value}, seed {request.seed}, {reply.skipped} indices without a scenario",
        },
    )
    if failed:
        write_whole(folder / GALLERY_FILE, gallery_html(content))
    write_whole(folder / REPORT_FILE, report_html(content))
    scores = scores_of(reply.records, time_limit_s=replays.world.config.episode.time_limit_s)
    write_whole(folder / LATEX_FILE, latex(scores))


def _tables(reply: EvaluateReply, request: EvaluateRequest, time_limit_s: float) -> dict[str, str]:
    """Tables of the report by heading."""
    compared = [
        comparison
        for reference in references(request.methods)
        for comparison in compare_all(reply.records, reference, time_limit_s=time_limit_s)
    ]
    return {
        "All measures": measures_html(scores_of(reply.records, time_limit_s=time_limit_s)),
        "Beside each other": comparisons_html(compared),
        "How they fail": failures_html(failure_counts(reply.records)),
    }


def plan_command(scene: str, request: EvaluateRequest, options: Mapping[str, object]) -> CommandOf | None:
    """Command lines of `readygo plan` that take an evaluation's episodes again.

    Args:
        scene: As it was named.
        request: What was asked for.
        options: Of the evaluation, as they were named; None for what was not.

    Returns:
        None if they would be driven otherwise.
    """
    if request.control_hz is not None or watched_method(request.methods) not in (POLICY, EXPERT):
        return None
    named = [word for name, value in options.items() if value is not None for word in (f"--{name}", str(value))]

    def command_of(record: EpisodeRecord) -> str:
        key, static = record.episode, ["--static"] if record.task is Task.STATIC else []
        place = ["--split", key.split.value, "--seed", str(key.seed), "--index", str(key.index)]
        return shlex.join(["readygo", "plan", scene, *named, *place, *static, "--picture", "failure.png"])

    return command_of


def shown(failed: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """The failures that find room on a page, of every task and kind in turn, and in the order in which they came."""
    groups: dict[object, list[EpisodeRecord]] = {}
    for record in failed:
        groups.setdefault((record.task, record.result.outcome), []).append(record)
    turns = [record for turn in range(len(failed)) for group in groups.values() for record in group[turn : turn + 1]]
    return [record for record in failed if record in turns[:SHOWN_MAX]]


def film_path(folder: Path, record: EpisodeRecord) -> Path:
    """Where an episode's film lies."""
    name = f"{record.task.value}-{short_name(record.method)}-{record.episode.index:06d}{FILM_ENDING}"
    return folder / FILMS_FOLDER / name


def _watched(request: EvaluateRequest, reply: EvaluateReply) -> list[EpisodeRecord]:
    return [record for record in reply.records if record.method == watched_method(request.methods)]


def _failure(
    replays: Replays, record: EpisodeRecord, trajectory: RobotTrajectory, command_of: CommandOf | None
) -> Failure:
    goal_x, goal_y = replays.episode(record).scenario.goal_xy_m.tolist()
    x, y, _ = trajectory.xyyaw[-1].tolist()
    film = film_path(replays.folder, record)
    return Failure(
        record=record,
        goal_distance_m=math.hypot(goal_x - x, goal_y - y),
        picture=replays.draw(record, trajectory),
        strip=replays.strip(record, trajectory),
        film=film if film.exists() else None,
        # Nobody makes way there for whoever drives.
        command=command_of(record) if command_of and record.task is not Task.REACTIVE else "",
    )
