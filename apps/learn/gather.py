"""Content of the report of a learning run, from its folder and its test episodes."""

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.curve import CurvePoint
from readygo.apps.learn.plan import FIRST_FOLDER, REFINED_FOLDER, LearnPlan
from readygo.apps.learn.training import read_losses
from readygo.apps.pictures.playback import latest_pictured, rows_of
from readygo.apps.pictures.recorded import RecordedEpisodes
from readygo.apps.report.evaluation import FAILURES, GALLERY_FILE, REPORT_FILE
from readygo.apps.report.learn import Ends, ReportContent, RunNumbers
from readygo.apps.report.page import CommandLine, MediaFigure, PageLink, StripImage, film, percent
from readygo.apps.report.tables import DriverScore, people_note
from readygo.common.dataset import Dataset, EpisodeEntry
from readygo.common.drawing.charts import Curve
from readygo.common.episode import wilson_interval
from readygo.common.messages import DriverKind, Outcome
from readygo.common.scenes.top_view import TopView, top_view
from readygo.runs.policy import policy_sha256
from readygo.runs.world import World
from readygo.services.evaluator import EvaluateReply

TASK_NAMES = {"static": "static", "dynamic": "among humans"}
TEST_FOLDER = "evaluation"
"""Folder of the test episodes, with one for every scene."""
LATEST = 100
"""Number of latest policy-driven episodes whose failures are shown."""
FILMS = 2
"""Number of videos of failures."""
STRIP_STEPS = (-30, -22, -15, -9, -4, 0)
"""Samples of the film strip, relative to the moment at which a visible human is nearest."""
SEARCHED = 20
"""Number of episodes to search for the one that shows a human best."""


def gather(
    plan: LearnPlan,
    points: Sequence[CurvePoint],
    chosen: PolicyMeasurement | None,
    replies: Mapping[str, EvaluateReply],
    run: RunNumbers,
    commands: tuple[CommandLine, ...],
) -> ReportContent:
    """The report's content; maps and videos are those of the first scene.

    Args:
        plan: Plan of the learning run.
        points: Learning curve.
        chosen: The measurement of the policy that was kept.
        replies: Results of the test episodes by scene; empty without a test.
        run: Numbers of the recording.
        commands: Commands for the next steps.
    """
    place = plan.places[0]
    world = World(place.spec)
    dataset = Dataset(place.folder.path)
    recorded = RecordedEpisodes(dataset, world.scene.maps.robot)
    view = top_view(world.scene)
    films, scores = plan.out / "films", driver_scores(replies)
    driven = [entry for entry in dataset.episodes if entry.driver is DriverKind.POLICY][-LATEST:]
    seen = recorded.best_encounter(list(dataset.episodes[-SEARCHED:]))
    origin = dataset.provenance
    return ReportContent(
        title=f"A policy for {', '.join(each.name for each in plan.places)}",
        subtitle=f"{_story(scores)}It learned from that place's Gaussians alone: a fleet recorded what the "
        "newest policy did and what its teacher would have done, while a trainer learned from it, on this machine.",
        hero=_hero(films, recorded, driven, view),
        scene_name=place.name,
        scene_note=f"{len(world.scene.cloud):,} Gaussians; {len(world.avatars)} humans can walk in it.",
        top_view=view,
        occupancy=world.scene.maps.robot,
        episodes=tuple(recorded.draw_episode(entry) for entry in dataset.episodes[:6]),
        strip=_strip(recorded, seen),
        strip_note=f"Episode {seen.episode.episode_id}, as recorded: {dataset.width_px}x{dataset.height_px}.",
        **_rates(points),
        losses=tuple(read_losses(plan.out / "policy")),
        training_note=_chosen_note(chosen) + _refined_note(plan, chosen),
        ends=_ends(dataset, driven),
        ends_note=f"Last places of the latest {len(driven)} recorded episodes that policies drove in {place.name}.",
        films=tuple(_failures(films, recorded, driven, view)),
        pages=tuple(_pages(plan.out, replies)),
        scores=tuple(dataclasses.replace(score, driver=score.driver.replace("-", " ")) for score in scores),
        scores_note=people_note(unseen=plan.tested != plan.avatars),
        run=run,
        commands=commands,
        provenance={
            "readygo_version": origin.readygo_version,
            "commit": origin.commit,
            "numeric_class": origin.numeric_class,
            "scenes": ", ".join(f"{each.name} {each.spec.scene_hash[:12]}" for each in plan.places),
            "policy": chosen.policy if chosen else "",
        },
    )


def _story(scores: Sequence[DriverScore]) -> str:
    """The test result of the policy in a sentence; empty without a test."""
    tasks = list(dict.fromkeys(score.task for score in scores))
    rates = {(score.driver, score.task): percent(score.summary.success_rate) for score in scores}
    told = [f"{rates['policy', task]} {task}" for task in tasks if ("policy", task) in rates]
    expert = [f"{rates['expert', task]} {task}" for task in tasks if ("expert", task) in rates]
    if not told:
        return ""
    taught = f"; the expert, which knows the map, in {' and '.join(expert)}" if expert else ""
    return f"From its camera alone it reaches its goal in {' and '.join(told)}{taught}. "


def _rates(points: Sequence[CurvePoint]) -> dict[str, Any]:
    """Success rates over minutes and over samples, by field of the report."""
    measured = [(point, point.measurement) for point in points if point.measurement is not None]
    axes = {
        "rates": np.array([point.minutes for point, _ in measured]),
        "rates_by_samples": np.array([float(point.learned) for point, _ in measured]),
    }
    rates = {
        "static": [(measurement.static, measurement.episodes) for _, measurement in measured],
        "among humans": [(measurement.dynamic, measurement.episodes) for _, measurement in measured],
    }
    return {
        axis: tuple(
            Curve(name=name, x=x, y=np.array([100 * rate for rate, _ in by_point]), interval=_intervals(by_point))
            for name, by_point in rates.items()
        )
        for axis, x in axes.items()
    }


def _intervals(rates: Sequence[tuple[float, int]]) -> Any:
    """95 % intervals of (rate, episodes) [%], shape (2, N)."""
    ends = [wilson_interval(round(rate * episodes), episodes) for rate, episodes in rates]
    return 100 * np.array(ends, dtype=np.float64).reshape(-1, 2).T


def _chosen_note(chosen: PolicyMeasurement | None) -> str:
    if chosen is None:
        return "The policy is the last one: none was measured on the split val."
    return (
        f"The policy that was kept is the best on the split val: {100 * chosen.static:.0f} % static and "
        f"{100 * chosen.dynamic:.0f} % among humans, {chosen.episodes} episodes each, after "
        f"{100 * chosen.fraction:.0f} % of the budget. The split test had no part in any choice."
    )


def _refined_note(plan: LearnPlan, chosen: PolicyMeasurement | None) -> str:
    """A sentence where the policy is the one that learned last in the form "paper", whose losses are elsewhere."""
    folder = plan.out / REFINED_FOLDER / "policy"
    if chosen is None or not folder.is_dir() or policy_sha256(folder) != chosen.policy:
        return ""
    return (
        f" It learned in {REFINED_FOLDER}/, with perception from all images; these losses are of the policy before it."
    )


def _ends(dataset: Dataset, driven: Sequence[EpisodeEntry]) -> tuple[Ends, ...]:
    def places(outcome: Outcome) -> list[Any]:
        return [dataset.poses[rows_of(entry).stop - 1, :2] for entry in driven if entry.outcome is outcome]

    return tuple(
        Ends(name=name, xy_m=np.array(places(outcome), dtype=np.float64).reshape(-1, 2))
        for outcome, name in FAILURES.items()
    )


def _hero(
    folder: Path, recorded: RecordedEpisodes, driven: Sequence[EpisodeEntry], view: TopView
) -> MediaFigure | None:
    """Video of the latest successful episode of a policy that shows a human best; None without one."""
    reached = [entry for entry in reversed(driven) if entry.outcome is Outcome.SUCCESS][:SEARCHED]
    return (
        _film(folder / "reached.webm", recorded, recorded.best_encounter(reached), view, plays=True)
        if reached
        else None
    )


def _failures(
    folder: Path, recorded: RecordedEpisodes, driven: Sequence[EpisodeEntry], view: TopView
) -> list[MediaFigure]:
    """Videos of the latest failed episodes of a policy, of each kind in turn."""
    kinds = [[entry for entry in reversed(driven) if entry.outcome is outcome] for outcome in FAILURES]
    chosen = [entry for turn in zip_longest(*kinds) for entry in turn if entry is not None][:FILMS]
    return [_film(folder / f"failed{k}.webm", recorded, entry, view) for k, entry in enumerate(chosen)]


def _film(
    path: Path, recorded: RecordedEpisodes, entry: EpisodeEntry, view: TopView, *, plays: bool = False
) -> MediaFigure:
    recorded.write_film(path, entry, view)
    what = FAILURES.get(entry.outcome, "reached the goal")
    return film(path, f"Episode {entry.episode.episode_id}, driven by a policy: {what}.", plays=plays)


def _pages(out: Path, replies: Mapping[str, EvaluateReply]) -> list[PageLink]:
    """The pages of the test episodes in each scene, and that of the encoder's perception."""
    pages = {GALLERY_FILE: "failures", REPORT_FILE: "all drivers"}
    first = Path(FIRST_FOLDER) / REPORT_FILE
    perceives = [PageLink(href=str(first), what="perception, and the teacher")] if (out / first).exists() else []
    return perceives + [
        PageLink(href=f"{TEST_FOLDER}/{name}/{file}", what=f"{what} in {name}")
        for name in replies
        for file, what in pages.items()
        if (out / TEST_FOLDER / name / file).exists()
    ]


def _strip(recorded: RecordedEpisodes, entry: EpisodeEntry) -> tuple[StripImage, ...]:
    centre = int(np.argmax(recorded.nearness(entry)))
    first = min(max(centre, -STRIP_STEPS[0]), entry.sample_count - 1)
    steps = sorted({max(0, first + offset) for offset in STRIP_STEPS})
    dataset = recorded.dataset
    pictured = latest_pictured(dataset, rows_of(entry))
    return tuple(
        StripImage(rgb=dataset.decode(int(pictured[step])), time_s=step * dataset.clock.dt_s) for step in steps
    )


def driver_scores(replies: Mapping[str, EvaluateReply]) -> list[DriverScore]:
    """The success of all drivers in the test of each scene."""
    return [
        DriverScore(
            task=TASK_NAMES[task.value] if len(replies) == 1 else f"{TASK_NAMES[task.value]}, {name}",
            driver=method,
            summary=summary,
        )
        for name, reply in replies.items()
        for (task, method), summary in reply.summaries.items()
    ]
