"""Writes the videos and pages of an evaluation from its saved results."""

import math
from collections.abc import Sequence
from pathlib import Path

from readygo.apps.evaluation.again import keep_spec, plan_command
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
from readygo.services.evaluator import EpisodeRecord, EvaluateReply, EvaluateRequest, short_name
from readygo.services.evaluator.scores import compare_all, failure_counts, scores_of

LATEX_FILE = "table.tex"
FILMS_FOLDER, FILM_ENDING = "films", ".webm"
SHOWN_MAX = 24
"""Largest number of failures on a page."""


def write_films(replays: Replays, request: EvaluateRequest, reply: EvaluateReply, wanted: Sequence[str]) -> None:
    """Write the requested videos that do not exist yet.

    Args:
        replays: Replays of the evaluation.
        request: Request of the evaluation.
        reply: Result of the evaluation.
        wanted: Episodes to film: "failures", "worst" or indices.

    Raises:
        RunError: If a requested episode was not driven.
        ReadygoError: If a video cannot be written.
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
) -> None:
    """Write the report and, if an episode failed, the gallery of failures, with the existing videos.

    The files that `readygo plan --from` needs are written as well.

    Args:
        replays: Replays of the evaluation.
        request: Request of the evaluation.
        reply: Result of the evaluation.
        title: Driver and scene, for the heading.

    Raises:
        ReadygoError: If a file cannot be written.
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
        failures=[_failure(replays, record, run) for record, run in chosen],
        tables=_tables(reply, request, replays.world.config.episode.time_limit_s),
        films=[(record, film_path(folder, record)) for record in records if film_path(folder, record).exists()],
        facts={
            "scene": f"{scene.name} {scene.content_hash[:12]}",
            "episodes": f"split {request.split.value}, seed {request.seed}, {reply.skipped} indices without a scenario",
        },
    )
    keep_spec(folder, replays.world.spec)
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


def shown(failed: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """The failures to show, at most `SHOWN_MAX`: taken from every task and kind in turn, in their original order."""
    groups: dict[object, list[EpisodeRecord]] = {}
    for record in failed:
        groups.setdefault((record.task, record.result.outcome), []).append(record)
    turns = [record for turn in range(len(failed)) for group in groups.values() for record in group[turn : turn + 1]]
    return [record for record in failed if record in turns[:SHOWN_MAX]]


def film_path(folder: Path, record: EpisodeRecord) -> Path:
    """Path of an episode's video."""
    name = f"{record.task.value}-{short_name(record.method)}-{record.episode.index:06d}{FILM_ENDING}"
    return folder / FILMS_FOLDER / name


def _watched(request: EvaluateRequest, reply: EvaluateReply) -> list[EpisodeRecord]:
    return [record for record in reply.records if record.method == watched_method(request.methods)]


def _failure(replays: Replays, record: EpisodeRecord, trajectory: RobotTrajectory) -> Failure:
    goal_x, goal_y = replays.episode(record).scenario.goal_xy_m.tolist()
    x, y, _ = trajectory.xyyaw[-1].tolist()
    film = film_path(replays.folder, record)
    return Failure(
        record=record,
        goal_distance_m=math.hypot(goal_x - x, goal_y - y),
        picture=replays.draw(record, trajectory),
        strip=replays.strip(record, trajectory),
        film=film if film.exists() else None,
        command=plan_command(replays.folder, record),
    )
