"""From what an evaluation kept to films and pages."""

import math
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
from readygo.common.files import write_whole
from readygo.common.messages import RobotTrajectory
from readygo.services.evaluator import EpisodeRecord, EvaluateReply, EvaluateRequest

FILMS_FOLDER, FILM_ENDING = "films", ".mp4"
SHOWN_MAX = 24
"""Failures on a page."""

CommandOf = Callable[[EpisodeRecord], str]
"""The command line that shows more of an episode; empty if there is none."""


def write_films(replays: Replays, records: Sequence[EpisodeRecord], wanted: Sequence[str], folder: Path) -> None:
    """Write the films that are wanted and not there yet.

    Args:
        replays: Of the evaluation.
        records: Of the method that is watched.
        wanted: See `filmed`.
        folder: Of the evaluation.

    Raises:
        RunError: If an episode that is wanted was not driven.
        ReadygoError: If a film cannot be written.
    """
    for record in replays.load(filmed(records, wanted)):
        path = film_path(folder, record)
        if not path.exists():
            replays.film(path, record)


def write_pages(
    replays: Replays,
    request: EvaluateRequest,
    reply: EvaluateReply,
    folder: Path,
    *,
    title: str,
    facts: Mapping[str, str],
    command_of: CommandOf = lambda record: "",
) -> None:
    """Write the report and, if anything failed, the gallery of failures, with the films that are there.

    Raises:
        ReadygoError: If they cannot be written.
    """
    watched = watched_method(request.methods)
    records = [record for record in reply.records if record.method is watched]
    runs = [(record, replays.trajectory(record)) for record in replays.load(records)]
    failed = sorted((record for record in records if record.result.outcome in FAILURES), key=badness)
    chosen = shown(failed)
    content = EvaluationContent(
        title=title,
        watched=watched,
        summaries=reply.summaries,
        occupancy=replays.world.scene.maps.robot,
        runs=runs,
        failure_count=len(failed),
        failures=[_failure(replays, record, run, folder, command_of) for record, run in runs if record in chosen],
        films=[(record, film_path(folder, record)) for record in records if film_path(folder, record).exists()],
        facts=facts,
    )
    if failed:
        write_whole(folder / GALLERY_FILE, gallery_html(content))
    write_whole(folder / REPORT_FILE, report_html(content))


def shown(failed: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """The failures that find room on a page, of every task and kind in turn."""
    groups: dict[object, list[EpisodeRecord]] = {}
    for record in failed:
        groups.setdefault((record.task, record.result.outcome), []).append(record)
    turns = [record for turn in range(len(failed)) for group in groups.values() for record in group[turn : turn + 1]]
    return turns[:SHOWN_MAX]


def film_path(folder: Path, record: EpisodeRecord) -> Path:
    """Where an episode's film lies."""
    name = f"{record.task.value}-{record.method.value}-{record.episode.index:06d}{FILM_ENDING}"
    return folder / FILMS_FOLDER / name


def _failure(
    replays: Replays, record: EpisodeRecord, trajectory: RobotTrajectory, folder: Path, command_of: CommandOf
) -> Failure:
    goal_x, goal_y = replays.episode(record).scenario.goal_xy_m.tolist()
    x, y, _ = trajectory.xyyaw[-1].tolist()
    film = film_path(folder, record)
    return Failure(
        record=record,
        goal_distance_m=math.hypot(goal_x - x, goal_y - y),
        picture=replays.draw(record, trajectory),
        strip=replays.strip(record, trajectory),
        film=film if film.exists() else None,
        command=command_of(record),
    )
