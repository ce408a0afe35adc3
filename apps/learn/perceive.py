"""`readygo learn` in the form "perceive": record, train perception, and test the better of the drivers that use it.

    RUN/people/         varied avatars that walk in the data
    RUN/data/NAME/      a data folder for every scene, and NAME-crowd/ with more humans at a time
    RUN/perception/     the network, with its checkpoint
    RUN/rl/             a policy on states of `readygo rl`, trained meanwhile on another core
    RUN/evaluation/     the test episodes; report.html shows all of it
    RUN/perceive.json   the scenes, and the episodes that each of them has
    RUN/settings.toml   the settings of the test, for `--config`

Every step resumes, so the same command resumes the run; with more minutes it trains longer on the same data.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from readygo.apps.fleet.run import count_recorded, record
from readygo.apps.learn.gather import TEST_FOLDER, driver_scores
from readygo.apps.learn.learn import success_by_scene
from readygo.apps.learn.measure import drive_test
from readygo.apps.learn.perceive_plan import (
    FORMAT,
    SETTINGS_FILE,
    PerceivePlan,
    has_policy_on_states,
    read_state,
    tested_settings,
    variants_of,
    workers_of,
    write_state,
)
from readygo.apps.learn.plan import free_name, lock_folder
from readygo.apps.learn.reinforcement import reinforcement
from readygo.apps.report.evaluation import REPORT_FILE
from readygo.apps.report.page import CommandLine, PageLink
from readygo.apps.report.perception import PerceptionContent
from readygo.common.avatars.variants import write_variants
from readygo.common.config import section_to_mapping
from readygo.common.documents import write_toml
from readygo.common.errors import ReadygoError, RunError
from readygo.common.messages import RunSpec, Split, StatusReply
from readygo.common.state_policy.state_policy import is_state_policy
from readygo.runs.config import with_mix
from readygo.runs.evaluation import evaluation_settings, evaluation_world, make_evaluator
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import PERCEIVE_AND_ACT, PERCEIVE_AND_PLAN, RL, named_methods
from readygo.runs.perception import train_perception
from readygo.runs.policy import with_expert
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.services.evaluator import (
    EXPERT,
    STRAIGHT_LINE,
    EpisodeRecord,
    EvaluateReply,
    EvaluateRequest,
    Task,
    handle_evaluate,
)
from readygo.services.planner import MixName
from readygo.services.trainer import PerceptionConfig

RECORD_SHARE = 0.35
"""Share of the time in which data are recorded."""
FIRST_EPISODES = 24
"""First episodes of a data folder, which tell about how long one takes."""
RECORDED = 0.9
"""Share of its time after which a data folder is left as it is: processes would start for a few episodes."""
CROWD: MixName = "crowd"
"""Scenario mix of half of the data: more humans in an image."""
VAL_EPISODES = 30
"""Episodes of the split val among pedestrians that choose between the drivers, in all scenes together."""
DRIVERS = (PERCEIVE_AND_ACT, PERCEIVE_AND_PLAN)
BESIDE = (EXPERT, STRAIGHT_LINE)
"""Methods that are tested beside the chosen driver."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Perceived:
    """Result of a run."""

    plan: PerceivePlan
    metrics: Mapping[str, Any]
    """What `metrics.json` of the network holds."""
    method: str
    """The chosen driver."""
    val: Mapping[str, float]
    """Success rates of the drivers on the split val; empty if there was no choice."""
    replies: Mapping[str, EvaluateReply]
    """Results of the test episodes by scene."""
    minutes: float

    def to_mapping(self) -> dict[str, Any]:
        """Plain values for scripts."""
        return {
            "method": self.method,
            "val": dict(self.val),
            "perception": str(self.plan.perception),
            "minutes": round(self.minutes, 2),
            "metrics": dict(self.metrics),
            "test": success_by_scene(self.replies),
            "report": str(self.plan.out / "report.html"),
        }


@dataclass(frozen=True, kw_only=True)
class Step:
    """How far a run is."""

    name: str
    """What is done now: "recording", "training", "reinforcement" or "choice"."""
    fraction: float
    """Share of it that is done."""
    words: str = ""


Show = Callable[[Step], None]


def training_step(name: str, fraction: float, loss: float) -> Step:
    """How far a training is; its loss is left out while it is not known."""
    return Step(name=name, fraction=fraction, words=f"loss {loss:.2f}" if math.isfinite(loss) else "")


def learn_to_perceive(
    plan: PerceivePlan,
    *,
    episodes: int,
    show: Show = lambda step: None,
    tested: Callable[[EpisodeRecord], None] = lambda record: None,
) -> Perceived:
    """Record, train and test, or resume that.

    Args:
        plan: From `check_plan`.
        episodes: Test episodes per task and scene; 0 drives none.
        show: Told of the progress.
        tested: Told of every test episode.

    Raises:
        ReadygoError: If the run cannot continue; what is recorded and trained stays.
    """
    with lock_folder(plan.out) as lock:
        return _learn(plan, episodes, show, tested, lock)


def _learn(
    plan: PerceivePlan, episodes: int, show: Show, tested: Callable[[EpisodeRecord], None], lock: int
) -> Perceived:
    state = {
        "format": FORMAT,
        "scenes": [open_scene(scene).content_hash for scene in plan.scenes],
        "episodes": {},
        "recording_s": {},
        "minutes": 0.0,
        "variants": variants_of(plan.minutes),
        **read_state(plan),
    }
    write_state(plan, state)
    settings = section_to_mapping(tested_settings(plan.config))
    told = {name: section for name, section in settings.items() if name not in ("recorder", "coordinator")}
    write_toml(plan.out / SETTINGS_FILE, told, raises=RunError)
    write_variants(plan.learned, plan.people, int(state["variants"]), plan.seed)
    names: list[str] = []
    for scene in plan.scenes:
        names.append(free_name(open_scene(scene).name or "scene", names))
    mixes = {"": plan.config, f"-{CROWD}": with_mix(plan.config, CROWD)}
    recorded = [
        (scene, name + end, config)
        for name, scene in zip(names, plan.scenes, strict=True)
        for end, config in mixes.items()
    ]
    with reinforcement(plan, lock) as check_policy:
        for scene, folder, config in recorded:
            check_policy()
            budget_s = 60.0 * plan.minutes * RECORD_SHARE / len(recorded)
            spec = make_spec(open_scene(scene), plan.people, config, seed=plan.seed, split=Split.TRAIN, static=False)
            _record(plan, with_expert(spec), folder, budget_s, state, show)
        check_policy()
        metrics = _train(plan, [plan.out / "data" / folder for _, folder, _ in recorded], state, show)
        show(Step(name="reinforcement", fraction=1.0, words="waiting for the policy on states"))
        check_policy(wait=True)
    val = _choose(plan, state, show) if episodes else {}
    method = max(DRIVERS, key=lambda name: val.get(name, -1.0)) if val else PERCEIVE_AND_PLAN
    replies = {
        name: _test(plan, scene, name, method, episodes, tested)
        for name, scene in zip(names, plan.scenes, strict=True)
        if episodes
    }
    return Perceived(
        plan=plan, metrics=metrics, method=method, val=val, replies=replies, minutes=float(state["minutes"])
    )


def _choose(plan: PerceivePlan, state: dict[str, Any], show: Show) -> dict[str, float]:
    """Success rates of the drivers on the split val, means over the scenes; empty without a policy on states."""
    if not (has_policy_on_states(plan) and is_state_policy(plan.out / RL)):
        return {}
    hashes = method_hashes(DRIVERS, plan.out)
    if state.get("val", {}).get("hashes") != hashes:
        episodes = math.ceil(VAL_EPISODES / len(plan.scenes))
        total, done = len(DRIVERS) * episodes * len(plan.scenes), itertools.count(1)

        def tell(record: EpisodeRecord) -> None:
            show(Step(name="choice", fraction=next(done) / total, words=record.method))

        found = [_val_rates(plan, scene, episodes, tell) for scene in plan.scenes]
        rates = {method: fmean(of_scene[method] for of_scene in found) for method in DRIVERS}
        state["val"] = {"hashes": hashes, "rates": rates}
        write_state(plan, state)
    return dict(state["val"]["rates"])


def _val_rates(
    plan: PerceivePlan, scene: str, episodes: int, tell: Callable[[EpisodeRecord], None]
) -> dict[str, float]:
    """Success rates of the drivers among pedestrians on the split val of a scene."""
    world = evaluation_world(scene, tested_settings(plan.config), avatars=plan.learned, seed=plan.seed, split=Split.VAL)
    evaluator = make_evaluator(world, renderer=world.renderer(), methods=named_methods(world, DRIVERS, plan.out))
    request = EvaluateRequest(
        tasks=(Task.DYNAMIC,), methods=DRIVERS, episodes=episodes, seed=plan.seed, split=Split.VAL
    )
    reply = handle_evaluate(evaluator, request, report=tell)
    return {method: summary.success_rate for (_, method), summary in reply.summaries.items()}


def _record(plan: PerceivePlan, spec: RunSpec, name: str, budget_s: float, state: dict[str, Any], show: Show) -> None:
    """Record one data folder: a few episodes, then again and again as many as there seems to be time for.

    The time of the first ones also has that in it in which processes start and kernels are compiled. An interrupted
    recording continues with the episodes that it was at.
    """
    folder, goals, spent = plan.out / "data" / name, state["episodes"], state["recording_s"]

    def tell(status: StatusReply) -> None:
        fraction = status.committed / max(status.wanted, 1)
        if name in spent:
            fraction = min((spent[name] + time.monotonic() - begin_s) / budget_s, 1.0)
        show(Step(name="recording", fraction=fraction, words=name))

    with _counted(plan, state):
        if name not in goals or name in spent:
            goals[name] = max(goals.get(name, 0), count_recorded(folder) + FIRST_EPISODES)
            spent.setdefault(name, 0.0)
        while True:
            write_state(plan, state)
            had, begin_s = count_recorded(folder), time.monotonic()
            record(spec, folder, episodes=goals[name], workers=workers_of(plan), show=tell)
            if name not in spent:
                return
            took_s = max(time.monotonic() - begin_s, 1e-3)
            spent[name] += took_s
            more = round((goals[name] - had) / took_s * (budget_s - spent[name]))
            if more < 1 or spent[name] > RECORDED * budget_s:
                del spent[name]
                return
            goals[name] += more


def _train(plan: PerceivePlan, folders: list[Path], state: dict[str, Any], show: Show) -> dict[str, Any]:
    # Decoding and labels take a tenth of the time or so.
    minutes = max(0.9 * (1.0 - RECORD_SHARE) * plan.minutes, 0.1)
    config = PerceptionConfig(minutes=minutes, seed=plan.seed, threads=workers_of(plan))
    with _counted(plan, state):
        return train_perception(
            folders,
            config,
            plan.perception,
            scenes=plan.scenes,
            show=lambda told: show(training_step("training", told.fraction, told.train_loss)),
        )


@contextmanager
def _counted(plan: PerceivePlan, state: dict[str, Any]) -> Iterator[None]:
    """Add the time of a block to the run's minutes, also where it is interrupted."""
    begin_s = time.monotonic()
    try:
        yield
    except BaseException:
        state["minutes"] = state["minutes"] + (time.monotonic() - begin_s) / 60.0
        with suppress(ReadygoError):
            write_state(plan, state)
        raise
    state["minutes"] = state["minutes"] + (time.monotonic() - begin_s) / 60.0
    write_state(plan, state)


def _test(
    plan: PerceivePlan, scene: str, name: str, method: str, episodes: int, tested: Callable[[EpisodeRecord], None]
) -> EvaluateReply:
    """Drive the test episodes of a scene, and write their pages."""
    world = evaluation_world(scene, tested_settings(plan.config), avatars=plan.tested, seed=plan.seed)
    methods = (method, *BESIDE)
    renderer, request = world.renderer(), EvaluateRequest(episodes=episodes, seed=plan.seed, methods=methods)
    evaluator = make_evaluator(world, renderer=renderer, methods=named_methods(world, methods, plan.out))
    hashes = method_hashes(methods, plan.out)
    return drive_test(
        evaluator,
        world,
        renderer,
        request,
        plan.out / TEST_FOLDER / name,
        settings=evaluation_settings(world, request, policy="", camera="policy", methods=hashes),
        title=f"{method} in {name}",
        report=tested,
    )


def perception_content(learned: Perceived, scenes: Sequence[str]) -> PerceptionContent:
    """The content of a run's report.

    Args:
        learned: Result of the run.
        scenes: Scenes as the user named them.
    """
    plan, places = learned.plan, list(learned.replies)
    test = f"readygo evaluate {scenes[0]} --methods {learned.method} expert --checkpoints {plan.out}"
    test += f" --config {plan.out / SETTINGS_FILE}" + (f" --avatars {plan.tested}" if plan.tested else "")
    teacher = f" --teacher {plan.out / RL}" if is_state_policy(plan.out / RL) else ""
    people = f" --avatars {plan.avatars}" if plan.avatars else ""
    return PerceptionContent(
        title=f"{learned.method} in {', '.join(places) or ', '.join(scenes)}",
        method=learned.method,
        val=learned.val,
        scores=driver_scores(learned.replies),
        metrics=learned.metrics,
        minutes=learned.minutes,
        unseen=plan.tested != plan.learned,
        pages=[PageLink(href=f"{TEST_FOLDER}/{name}/{REPORT_FILE}", what=name) for name in places],
        commands=[
            CommandLine(what="test it again, with videos", line=f"{test} --out {plan.out / 'again'} --video worst"),
            CommandLine(
                what="train longer on the same data",
                line=f"readygo train {plan.out / 'data'}/* --recipe perception --minutes "
                f"{2 * plan.minutes:g} --out {plan.perception}",
            ),
            CommandLine(
                what="a policy without a map, which learns from these",
                line=f"readygo learn {' '.join(scenes)} --form policy --perception {plan.perception}{teacher}{people} "
                "--out policy",
            ),
        ],
    )
