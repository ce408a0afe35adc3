"""Closed-loop success of a policy in the scenes of a run, in this process."""

import dataclasses
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from readygo.apps.evaluation.replay import Replays
from readygo.apps.evaluation.watch import write_films, write_pages
from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.plan import LearnPlan
from readygo.common.messages import Outcome, Split
from readygo.common.policy import PolicySpec, load_policy
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import (
    evaluation_settings,
    evaluation_world,
    make_evaluator,
    summarize,
)
from readygo.runs.origin import origin_of_runs, settings_of_policy, with_origin
from readygo.runs.policy import policy_sha256
from readygo.runs.world import World
from readygo.services.evaluator import (
    POLICY,
    EpisodeRecord,
    EvaluateReply,
    EvaluateRequest,
    Evaluator,
    Task,
    handle_evaluate,
    is_of,
    open_results,
)
from readygo.services.renderer import Renderer


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measurement, with its policy and time."""

    measurement: PolicyMeasurement
    folder: Path
    """Folder of the policy."""
    episode_s: float
    """Mean time per episode [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Loaded:
    """A scene in which policies are measured."""

    world: World
    renderer: Renderer
    evaluator: Evaluator


class Measuring:
    """Measures policies in loaded scenes; the first measurement among some avatars loads them."""

    def __init__(self, plan: LearnPlan) -> None:
        self._plan = plan
        self._loaded: tuple[Path | None, list[_Loaded]] | None = None

    def val(
        self,
        folder: Path,
        sha256: str,
        episodes: int,
        fraction: float,
        *,
        report: Callable[[str, EpisodeRecord], None] = lambda name, record: None,
    ) -> Measured:
        """Success rates on the split val: of static and dynamic episodes, over all scenes.

        Args:
            folder: Folder of the policy.
            sha256: SHA-256 by which the run names the policy.
            episodes: Episodes per task, divided among the scenes.
            fraction: Share of the budget that is spent.
            report: Called with the scene's name and the record of each episode; an exception ends the measurement.

        Raises:
            PolicyError: If the policy cannot be used.
        """
        policy = load_policy(folder)
        each = max(1, -(-episodes // len(self._plan.places)))
        request = EvaluateRequest(methods=(POLICY,), episodes=each, seed=self._plan.seed, split=Split.VAL)
        loaded, begin_s = self._among(self._plan.avatars), time.monotonic()
        replies = [
            handle_evaluate(
                dataclasses.replace(at.evaluator, policy=policy), request, report=partial(report, place.name)
            )
            for place, at in zip(self._plan.places, loaded, strict=True)
        ]
        records = [record for reply in replies for record in reply.records]
        measurement = PolicyMeasurement(
            fraction=fraction,
            policy=sha256,
            episodes=each * len(self._plan.places),
            static=success_rate(records, Task.STATIC),
            dynamic=success_rate(records, Task.DYNAMIC),
        )
        episode_s = (time.monotonic() - begin_s) / len(records)
        return Measured(measurement=measurement, folder=folder, episode_s=episode_s)

    def test(
        self,
        folder: Path,
        episodes: int,
        out: Path,
        report: Callable[[EpisodeRecord], None],
        videos: Sequence[str] = (),
    ) -> dict[str, EvaluateReply]:
        """Records of policy, expert and straight line on the split test, by scene; also written into `out`.

        Episodes of the same policy in `out` are not driven again; those of a different policy are removed. The pages
        of `readygo evaluate` are written beside them.

        Args:
            folder: Folder of the policy.
            episodes: Episodes per task and scene.
            out: Folder for the results, with a folder per scene.
            report: Called with the record of every episode.
            videos: Episodes of which videos are written, as for `readygo evaluate --video`.

        Raises:
            PolicyError: If the policy cannot be used.
        """
        policy, sha256 = load_policy(folder), policy_sha256(folder)
        request = EvaluateRequest(episodes=episodes, seed=self._plan.seed)
        replies = {}
        for place, at in zip(self._plan.places, self._among(self._plan.tested), strict=True):
            replies[place.name] = drive_test(
                dataclasses.replace(at.evaluator, policy=policy),
                at.world,
                at.renderer,
                request,
                out / place.name,
                settings=evaluation_settings(at.world, request, policy=sha256, camera="policy"),
                title=f"{folder} in {place.name}",
                report=report,
                videos=videos,
            )
        return replies

    def _among(self, avatars: Path | None) -> list[_Loaded]:
        """The scenes with these avatars; those with others are forgotten."""
        if self._loaded is None or self._loaded[0] != avatars:
            self._loaded = None
            self._loaded = avatars, [self._load(place.scene, avatars) for place in self._plan.places]
        return self._loaded[1]

    def _load(self, scene: str, avatars: Path | None) -> _Loaded:
        world = evaluation_world(scene, tried_settings(self._plan), avatars=avatars, seed=self._plan.seed)
        renderer = world.renderer()
        return _Loaded(world=world, renderer=renderer, evaluator=make_evaluator(world, renderer=renderer))


def drive_test(
    evaluator: Evaluator,
    world: World,
    renderer: Renderer,
    request: EvaluateRequest,
    out: Path,
    *,
    settings: Mapping[str, Any],
    title: str,
    report: Callable[[EpisodeRecord], None],
    videos: Sequence[str] = (),
) -> EvaluateReply:
    """Drive the test episodes of a scene that `out` does not have, and write the pages of `readygo evaluate` there.

    Args:
        evaluator: Drivers of the test.
        world: World of the test.
        renderer: Draws the videos.
        request: Which episodes.
        out: Folder for the results; what it has of other settings is removed.
        settings: All that the results depend on, from `evaluation_settings`.
        title: Driver and scene, for the heading.
        report: Called with the record of every episode.
        videos: Episodes of which videos are written, as for `readygo evaluate --video`.
    """
    if not is_of(out, settings):
        shutil.rmtree(out, ignore_errors=True)
    with open_results(out, settings) as results:
        reply = handle_evaluate(evaluator, request, report=report, results=results)
        results.finish(summarize(reply, request, evaluator))
        sees = evaluator.policy.spec.images if evaluator.policy else ()
        replays = Replays(world, results, reply.episodes, renderer, evaluator.simulation, sees=sees)
        write_films(replays, request, reply, videos)
        write_pages(replays, request, reply, title=title)
    return reply


def tried_settings(plan: LearnPlan) -> RunConfig:
    """The settings in which a plan's policies are evaluated: those that `readygo evaluate` takes from the policy."""
    bare = PolicySpec(robot=plan.config.robot, sensor=plan.config.renderer.sensor)
    return settings_of_policy(with_origin(bare, origin_of_runs(place.spec for place in plan.places)))


def success_rate(records: Sequence[EpisodeRecord], task: Task) -> float:
    """Share of a task's episodes that succeeded."""
    outcomes = [record.result.outcome for record in records if record.task is task]
    return sum(outcome is Outcome.SUCCESS for outcome in outcomes) / len(outcomes)
