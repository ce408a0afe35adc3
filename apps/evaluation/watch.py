"""Writes the videos and pages of an evaluation from its saved results."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from readygo.apps.evaluation.again import keep_spec, plan_command
from readygo.apps.evaluation.replay import Replays
from readygo.apps.report.evaluation import (
    FAILURES,
    GALLERY_FILE,
    REPORT_FILE,
    EvaluationContent,
    Failure,
    gallery_html,
    report_html,
)
from readygo.apps.report.page import Block
from readygo.apps.report.tables import comparison_tables, failure_tables, latex, measure_tables
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.messages import Outcome, RobotTrajectory
from readygo.runs.evaluation import references
from readygo.runs.world import World
from readygo.services.evaluator import (
    POLICY,
    EpisodeRecord,
    EvaluateReply,
    EvaluateRequest,
    Task,
    compare_all,
    failure_counts,
    scores_of,
    short_name,
)

LATEX_FILE = "table.tex"
FILMS_FOLDER, FILM_ENDING = "films", ".webm"
SHOWN_MAX = 24
"""Largest number of failures on a page."""
FAILED, WORST, AVOIDED = "failures", "worst", "avoided"
"""Values of `--video` besides indices."""
WORST_COUNT = 4
AVOIDED_COUNT = 2


def watched_method(methods: Sequence[str]) -> str:
    """Method whose episodes are filmed and shown: the policy if it drives, else the first method."""
    return POLICY if POLICY in methods else methods[0]


def check_wanted(wanted: Sequence[str], tasks: Sequence[str]) -> None:
    """Raise RunError unless each value of `--video` is a name or an index, and the tasks that it takes are driven."""
    for name in wanted:
        if name not in (FAILED, WORST, AVOIDED) and not name.isdecimal():
            raise RunError(f'--video takes "{FAILED}", "{WORST}", "{AVOIDED}" or indices of episodes, got {name!r}.')
    static = Task.STATIC.value
    if AVOIDED in wanted and (static not in tasks or set(tasks) == {static}):
        raise RunError(f"--video {AVOIDED} compares a task with humans with the one without: --tasks static dynamic.")


def episodes_to_film(
    records: Sequence[EpisodeRecord], wanted: Sequence[str], passed: Sequence[EpisodeRecord] = ()
) -> list[EpisodeRecord]:
    """The requested episodes, the worst first.

    Args:
        records: Episodes of one method.
        wanted: "failures" for all failures, "worst" for the few worst episodes, "avoided" for the few closest
            passes (`avoided`), and indices, of every task.
        passed: What `avoided` found, where that is wanted.

    Raises:
        RunError: If no episode has a requested index.
    """
    ranked = sorted(records, key=badness)
    failed = [record for record in ranked if record.result.outcome in FAILURES]
    indices = {int(name) for name in wanted if name.isdecimal()}
    missing = sorted(indices - {record.episode.index for record in records})
    if missing:
        raise RunError(f"No episode was driven with index {missing[0]}: indices without a scenario leave gaps.")
    chosen = failed if FAILED in wanted else ranked[:WORST_COUNT] if WORST in wanted else []
    chosen = [*chosen, *passed[:AVOIDED_COUNT]]
    return [record for record in ranked if record in chosen or record.episode.index in indices]


def avoided(records: Sequence[EpisodeRecord], replays: Replays) -> list[EpisodeRecord]:
    """Goals reached among humans of whom the same method meets one where it drives as without them; closest pass first.

    Args:
        records: Episodes of one method, with and without humans.
        replays: Replay the commands that it gave without humans.
    """
    alone = {record.episode: record for record in replays.load([r for r in records if r.task is Task.STATIC])}
    passed = [
        record
        for record in records
        if record.task is not Task.STATIC
        and record.result.outcome is Outcome.SUCCESS
        and record.episode in alone
        and replays.meets_human(record, alone[record.episode])
    ]
    return sorted(passed, key=lambda record: (record.human_distance_min_m, record.episode.index))


def badness(record: EpisodeRecord) -> tuple[int, float, int]:
    """Sort key, the worst first: kind of failure, then smallest distance to a human."""
    kinds = list(FAILURES)
    kind = kinds.index(record.result.outcome) if record.result.outcome in kinds else len(kinds)
    return kind, record.human_distance_min_m, record.episode.index


def write_films(replays: Replays, request: EvaluateRequest, reply: EvaluateReply, wanted: Sequence[str]) -> None:
    """Write the requested videos that do not exist yet.

    Args:
        replays: Replays of the evaluation.
        request: Request of the evaluation.
        reply: Result of the evaluation.
        wanted: Episodes to film: "failures", "worst", "avoided" or indices.

    Raises:
        RunError: If a requested episode was not driven.
        ReadygoError: If a video cannot be written.
    """
    records = _watched_records(request, reply)
    passed = avoided(records, replays) if AVOIDED in wanted else ()
    for record in replays.load(episodes_to_film(records, wanted, passed)):
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
    records, folder, scene = _watched_records(request, reply), replays.folder, replays.world.scene
    runs = {record.key: (record, replays.trajectory(record)) for record in replays.load(records)}
    failed = sorted((record for record in records if record.result.outcome in FAILURES), key=badness)
    chosen = [runs[record.key] for record in failures_to_show(failed) if record.key in runs]
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
            "pedestrians": pedestrians_text(replays.world),
        },
    )
    keep_spec(folder, replays.world.spec)
    if failed:
        write_whole(folder / GALLERY_FILE, gallery_html(content))
    write_whole(folder / REPORT_FILE, report_html(content))
    scores = scores_of(reply.records, time_limit_s=replays.world.config.episode.time_limit_s)
    write_whole(folder / LATEX_FILE, latex(scores))


def pedestrians_text(world: World) -> str:
    """How many pedestrians the dynamic episodes have, and how fast they are."""
    if world.spec.scenarios:
        return "as in the scenario file"
    episode, standing = world.config.episode, world.config.human_planner.standing_max
    count, speed = (
        (episode.human_count_min, episode.human_count_max),
        (episode.human_speed_min_mps, episode.human_speed_max_mps),
    )
    walking = f"{_range_text(*count)} at {_range_text(*speed)} m/s"
    return f"{walking}, and up to {standing} who stand" if standing else walking


def _range_text(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _tables(reply: EvaluateReply, request: EvaluateRequest, time_limit_s: float) -> Mapping[str, Sequence[Block]]:
    """Tables of the report by heading."""
    compared = [
        comparison
        for reference in references(request.methods)
        for comparison in compare_all(reply.records, reference, time_limit_s=time_limit_s)
    ]
    return {
        "All measures": measure_tables(scores_of(reply.records, time_limit_s=time_limit_s)),
        "Comparisons": comparison_tables(compared),
        "How they fail": failure_tables(failure_counts(reply.records)),
    }


def failures_to_show(failed: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
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


def _watched_records(request: EvaluateRequest, reply: EvaluateReply) -> list[EpisodeRecord]:
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
