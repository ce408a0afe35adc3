"""The whole of `readygo learn`: recording, training, learning curve, test and report."""

import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from readygo.apps.fleet.worker import make_coordinator
from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.crew import ALONE, Reach
from readygo.apps.learn.curve import CurvePoint
from readygo.apps.learn.gather import TEST_FOLDER, gather
from readygo.apps.learn.measure import Measuring
from readygo.apps.learn.plan import Budget, LearnPlan, lock_folder
from readygo.apps.learn.supervise import Now, Supervisor
from readygo.apps.report.learn import ReportContent, RunNumbers
from readygo.apps.report.page import CommandLine
from readygo.common.config import section_to_mapping
from readygo.common.messages import StatusRequest
from readygo.services.coordinator import handle_status
from readygo.services.evaluator import EpisodeRecord, EvaluateReply


@dataclass(frozen=True, kw_only=True, eq=False)
class Learned:
    """Result of a learning run."""

    plan: LearnPlan
    points: list[CurvePoint]
    chosen: PolicyMeasurement | None
    """The measurement of the policy that was kept."""
    replies: dict[str, EvaluateReply]
    """Results of the test episodes by scene."""
    minutes: float

    def to_mapping(self) -> dict[str, Any]:
        """Plain values for scripts."""
        latest = self.points[-1]
        return {
            "policy": str(self.plan.policy),
            "minutes": round(self.minutes, 2),
            "recorded": latest.recorded,
            "learned": latest.learned,
            "policies": latest.policies,
            "val": section_to_mapping(self.chosen) if self.chosen else None,
            "test": success_by_scene(self.replies),
            "report": str(self.plan.out / "report.html"),
        }


def success_by_scene(replies: Mapping[str, EvaluateReply]) -> dict[str, dict[str, float]]:
    """Success rates by scene, and by task and method, as plain values."""
    return {
        name: {
            f"{task.value} {method}": round(summary.success_rate, 4)
            for (task, method), summary in reply.summaries.items()
        }
        for name, reply in replies.items()
    }


def learn_policy(
    plan: LearnPlan,
    *,
    episodes: int,
    show: Callable[[Now], None] = lambda now: None,
    recorded: Callable[[], None] = lambda: None,
    tested: Callable[[EpisodeRecord], None] = lambda record: None,
    reach: Reach = ALONE,
    videos: Sequence[str] = (),
    refine: Callable[[], Path] | None = None,
) -> Learned:
    """Train a policy, or resume its training; then drive the test episodes.

    Args:
        plan: Plan of the learning run.
        episodes: Test episodes per task and scene; 0 drives none.
        show: Called with the progress, twice a second.
        recorded: Called when all data are recorded, before the test.
        tested: Called with the record of every test episode.
        reach: Access of workers on other machines.
        videos: Test episodes of which videos are written, as for `readygo evaluate --video`.
        refine: Trains another policy on the recorded data, and answers its folder; the better one on the split val is
            kept. None for no such training.

    Raises:
        ReadygoError: If the run cannot continue; recorded data and trained policies stay.
    """
    with lock_folder(plan.out):
        measuring = Measuring(plan)
        supervisor = Supervisor(plan, measuring, show, reach)
        chosen = supervisor.learn()
        recorded()
        if refine is not None:
            chosen = supervisor.take(refine())
        test = plan.out / TEST_FOLDER
        replies = measuring.test(plan.policy, episodes, test, tested, videos) if episodes else {}
    return Learned(plan=plan, points=supervisor.points, chosen=chosen, replies=replies, minutes=supervisor.minutes)


def report_content(
    learned: Learned, scenes: tuple[str, ...], options: Mapping[str, str] = MappingProxyType({})
) -> ReportContent:
    """The content of the report of a learning run.

    Args:
        learned: Result of the run.
        scenes: Scenes as the user named them.
        options: Further options of the command with their values, as the user gave them; with `--minutes` if the
            time of the command is more than this run's.
    """
    plan = learned.plan
    commands = _commands(plan, scenes, options)
    return gather(plan, learned.points, learned.chosen, learned.replies, _numbers(learned), commands)


def _numbers(learned: Learned) -> RunNumbers:
    """Numbers and times of the recording in all scenes."""
    episodes = samples = 0
    rejected: Counter[str] = Counter()
    cpu_s: Counter[str] = Counter()
    for place in learned.plan.places:
        coordinator = make_coordinator(place.folder)
        status = handle_status(coordinator, StatusRequest())
        coordinator.ledger.close()
        episodes, samples = episodes + status.committed, samples + status.samples
        rejected.update(status.rejected)
        cpu_s.update(status.cpu_s)  # type: ignore[arg-type]
    return RunNumbers(
        episodes=episodes,
        samples=samples,
        images=learned.plan.image_count(samples),
        learned=learned.points[-1].learned if learned.points else 0,
        wall_s=60 * learned.minutes,
        rejected=dict(rejected),
        cpu_s_by_stage=dict(cpu_s),
    )


def _twice(budget: Budget) -> list[str]:
    """The option that learns on for as long again."""
    if budget.samples is not None:
        return ["--samples", f"{2 * budget.samples}"]
    return ["--minutes", f"{2 * budget.minutes:g}"]


def _commands(plan: LearnPlan, scenes: tuple[str, ...], options: Mapping[str, str]) -> tuple[CommandLine, ...]:
    policy, data, budget = plan.policy, plan.places[0].folder.path, plan.budget
    people = f" --avatars {plan.tested}" if plan.tested else ""
    given = [word for option in options.items() for word in option if word]
    given += [] if "--minutes" in options else _twice(budget)
    resume = shlex.join(["readygo", "learn", *scenes, *given, "--out", str(plan.out)])
    return (
        CommandLine(what="learn on", line=resume),
        CommandLine(what="measure", line=f"readygo evaluate {scenes[0]} {policy}{people} --episodes 100"),
        CommandLine(what="check the data", line=f"readygo validate {data}"),
        CommandLine(what="what they cover", line=f"readygo coverage {data} --out {plan.out / 'coverage'}"),
        CommandLine(
            what="record more that it drives",
            line=f"readygo generate {scenes[0]} --policy {policy} --mix 0.5 --episodes 50 --out {plan.out / 'more'}",
        ),
        CommandLine(
            what="learn from data alone", line=f"readygo train {data} --minutes 60 --out {plan.out / 'offline'}"
        ),
    )
