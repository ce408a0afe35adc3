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

import dataclasses
import itertools
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from readygo.apps.fleet.run import count_recorded, record
from readygo.apps.learn.gather import TEST_FOLDER, driver_scores
from readygo.apps.learn.learn import success_by_scene
from readygo.apps.learn.measure import drive_test
from readygo.apps.learn.plan import LOCK_FILE, free_name, lock_folder, state_of
from readygo.apps.report.evaluation import REPORT_FILE
from readygo.apps.report.page import CommandLine, PageLink
from readygo.apps.report.perception import PerceptionContent
from readygo.common.avatars.cast import learned_and_tested
from readygo.common.avatars.variants import write_variants
from readygo.common.config import section_to_mapping
from readygo.common.cores import available_cores
from readygo.common.documents import write_json, write_toml
from readygo.common.errors import ConfigError, ReadygoError, RunError
from readygo.common.messages import RunSpec, Split, StatusReply
from readygo.common.robot import RobotConfig, load_robot
from readygo.common.state_policy.state_policy import is_state_policy
from readygo.runs.config import RunConfig, load_run_config, with_mix
from readygo.runs.evaluation import evaluation_settings, evaluation_world, make_evaluator
from readygo.runs.folder import check_new
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import PERCEIVE_AND_ACT, PERCEIVE_AND_PLAN, PERCEPTION, RL, named_methods
from readygo.runs.perception import train_perception
from readygo.runs.policy import with_expert
from readygo.runs.scene_argument import open_scene, open_scenes
from readygo.runs.sections import NO_KEYS, Keys
from readygo.runs.spec import make_spec
from readygo.services.driver import DriverConfig
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
from readygo.services.renderer import RendererConfig
from readygo.services.trainer import PerceptionConfig

FORMAT = "readygo-perceive/4"
ROBOT = RobotConfig()
STATE_FILE, SETTINGS_FILE = "perceive.json", "settings.toml"
VARIANTS_A_MINUTE, VARIANTS = 4, (56, 200)
"""Varied avatars that walk in the data: per minute of the run; at least, and at most. Each takes about 1 s."""
RECORD_SHARE = 0.35
"""Share of the time in which data are recorded."""
CAMERA_HZ = 5.0
"""Images a second: perception sees images that are 0.2 s apart."""
DISTURBED = 0.7
"""Share of the expert's episodes with noise injection: perception must know views off the expert's way."""
FIRST_EPISODES = 24
"""First episodes of a data folder, which tell about how long one takes."""
RECORDED = 0.9
"""Share of its time after which a data folder is left as it is: processes would start for a few episodes."""
CROWD: MixName = "crowd"
"""Scenario mix of half of the data: more humans in an image."""
VAL_EPISODES = 30
"""Episodes of the split val among pedestrians that choose between the drivers, in all scenes together."""
RL_SHARE = 0.6
"""Share of the time that the policy on states is trained for, besides the drawing of its episodes and its lessons."""
RL_EPISODES, RL_LESSONS = (100, 6000), (50, 3000)
"""Episodes that it drives in, and those in which the expert teaches it first: per minute of the run, and at most."""
DRIVERS = (PERCEIVE_AND_ACT, PERCEIVE_AND_PLAN)
BESIDE = (EXPERT, STRAIGHT_LINE)
"""Methods that are tested beside the chosen driver."""


@dataclass(frozen=True, kw_only=True)
class PerceivePlan:
    """Scenes, settings, budget and folder of a run."""

    out: Path
    scenes: tuple[str, ...]
    config: RunConfig
    minutes: float
    """Wall time of recording and training [min]."""
    avatars: Path | None
    """Avatars of the run; None for the embedded ones. Some are kept for the test, see `learned_and_tested`."""
    seed: int
    policy_on_states: bool = True
    """Train a policy on states beside, where there is a second core."""

    @property
    def perception(self) -> Path:
        """Folder of the network."""
        return self.out / PERCEPTION

    @property
    def learned(self) -> Path | None:
        """Avatars that are varied for the data, and walk on the split val."""
        return learned_and_tested(self.avatars)[0]

    @property
    def tested(self) -> Path | None:
        """Avatars that walk in the test."""
        return learned_and_tested(self.avatars)[1]

    @property
    def people(self) -> Path:
        """Folder of the varied avatars that walk in the data."""
        return self.out / "people"


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


def perceive_settings(
    config: Path | None, robot: Path | None, keys: Keys = NO_KEYS, *, usual: RobotConfig = ROBOT
) -> RunConfig:
    """The settings of the recording runs: levels of detail, no labels, noise injection.

    Args:
        config: TOML file with sections of settings.
        robot: The robot's file.
        keys: Keys of the command line, by section.
        usual: The robot if no file has one; also the camera of a robot's file that has none.

    Raises:
        ConfigError: If a file cannot be read or holds an unknown key or a wrong value.
    """
    own = load_robot(robot, cameras_of=usual) if robot else None
    base = RunConfig(
        robot=usual,
        driver=DriverConfig(disturbed=DISTURBED, camera_hz=CAMERA_HZ),
        renderer=RendererConfig(detail="lod", labels=False),
    )
    return load_run_config(config, own, base=base, keys=keys)


def check_plan(plan: PerceivePlan) -> None:
    """Check a plan before anything is written.

    Raises:
        RunError: If the budget is none, no scene is named, or one twice, or the folder holds something else.
        SceneError: If there is no such scene.
        AvatarError: If there are no avatars.
        ConfigError: If perception cannot be trained for the robot.
    """
    if not plan.minutes > 0:
        raise RunError(f"--minutes must be above 0, got {plan.minutes:g}.")
    if reason := not_one_camera(plan.config.robot):
        raise ConfigError(f"--form perceive is for one robot with one camera, not for {reason}: use --form policy.")
    hashes = [scene.content_hash for scene in open_scenes(plan.scenes)]
    # Avatars that are missing end here.
    learned_and_tested(plan.avatars)
    state = plan.out / STATE_FILE
    if state.exists():
        theirs = read_state(plan).get("scenes")
        if theirs != hashes:
            raise RunError(f"{plan.out} learns in other scenes; choose another --out.")
    else:
        check_new(plan.out, LOCK_FILE)


def not_one_camera(robot: RobotConfig) -> str:
    """What keeps perception from being trained for a robot; empty if nothing does."""
    return "a robot of ranges" if robot.ranges.varies else "several cameras" if robot.cameras else ""


def read_state(plan: PerceivePlan) -> dict[str, Any]:
    """What the run has done; empty for a new one.

    Raises:
        RunError: If the file is broken.
    """
    return state_of(plan.out / STATE_FILE, FORMAT)


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
    _write_state(plan, state)
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
    with _reinforcement(plan, lock) as check_policy:
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


def variants_of(minutes: float) -> int:
    """Number of varied avatars of a new run."""
    least, most = VARIANTS
    return max(least, min(int(VARIANTS_A_MINUTE * minutes), most))


def has_policy_on_states(plan: PerceivePlan) -> bool:
    """True if a policy on states is trained beside: on a separate core."""
    return plan.policy_on_states and available_cores() > 1


def workers_of(plan: PerceivePlan) -> int:
    """Cores for recording and training."""
    return available_cores() - has_policy_on_states(plan)


@contextmanager
def _reinforcement(plan: PerceivePlan, lock: int) -> Iterator[Callable[..., None]]:
    """Train a policy on states in another process; yields `_check_policy` of it.

    Its output is in RUN/rl.log. It inherits the lock: where this process is killed, the run is not resumed beside it.
    """
    if not has_policy_on_states(plan):
        yield lambda **_: None
        return
    episodes, lessons = (max(20, min(int(each * plan.minutes), most)) for each, most in (RL_EPISODES, RL_LESSONS))
    command = [
        *(sys.executable, "-m", "readygo", "rl", *plan.scenes, "--out", str(plan.out / RL)),
        *("--config", str(plan.out / SETTINGS_FILE), "--seed", str(plan.seed)),
        *("--minutes", f"{RL_SHARE * plan.minutes:g}"),
        *("--train-episodes", str(episodes), "--val-episodes", str(min(episodes, 400))),
        *("--demonstrations", str(lessons), "--workers", "1"),
        *(("--avatars", str(plan.learned)) if plan.learned else ()),
    ]
    one = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")}
    path = plan.out / "rl.log"
    with path.open("ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, **one}, pass_fds=(lock,))
        try:
            yield partial(_check_policy, process, path)
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()


def _check_policy(process: "subprocess.Popen[bytes]", log: Path, *, wait: bool = False) -> None:
    """Raise RunError with the last line of its output if the training of the policy on states failed.

    Args:
        process: The training.
        log: Its output.
        wait: Wait for its end.
    """
    code = process.wait() if wait else process.poll()
    if not code:
        return
    said = ["no message", *log.read_text(errors="replace").splitlines()][-1].removeprefix("readygo: ")
    raise RunError(f"The policy on states was not trained (exit code {code}, {log}): {said}")


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
        _write_state(plan, state)
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
        show(Step(name="recording", fraction=status.committed / max(status.wanted, 1), words=name))

    with _counted(plan, state):
        if name not in goals or name in spent:
            goals[name] = max(goals.get(name, 0), count_recorded(folder) + FIRST_EPISODES)
            spent.setdefault(name, 0.0)
        while True:
            _write_state(plan, state)
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
            show=lambda progress: show(
                Step(name="training", fraction=progress.fraction, words=f"loss {progress.train_loss:.2f}")
            ),
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
            _write_state(plan, state)
        raise
    state["minutes"] = state["minutes"] + (time.monotonic() - begin_s) / 60.0
    _write_state(plan, state)


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
                line=f"readygo learn {' '.join(scenes)} --form policy --perception {plan.perception}{teacher} "
                "--out policy",
            ),
        ],
    )


def tested_settings(config: RunConfig) -> RunConfig:
    """The settings of a run as its driver is tested: the rates and disturbances of recording are not part of it."""
    return dataclasses.replace(config, driver=DriverConfig())


def _write_state(plan: PerceivePlan, state: Mapping[str, Any]) -> None:
    write_json(plan.out / STATE_FILE, state, raises=RunError)
