"""`readygo evaluate`: success rates in closed loop."""

import json as json_module
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Positional

from readygo.apps.commands.evaluate_logs import evaluate_logs
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.evaluation.replay import PERCEIVING, Replays
from readygo.apps.evaluation.watch import (
    check_wanted,
    pedestrians_text,
    watched_method,
    write_films,
    write_pages,
)
from readygo.apps.fleet.evaluation import EvaluationFleet, by_fleet, fleet_spec, make_plan
from readygo.apps.fleet.options import RouterOptions
from readygo.apps.fleet.run import check_counts
from readygo.apps.options import given_options
from readygo.apps.report.evaluation import REPORT_FILE
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.config import section_to_mapping
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.common.perception import Perception, load_perception
from readygo.common.policy import Policy, load_policy, load_spec
from readygo.common.robot import load_robot
from readygo.runs.config import EvaluationKeys, RunConfig
from readygo.runs.evaluation import (
    CameraName,
    evaluation_config,
    evaluation_settings,
    evaluation_world,
    make_evaluator,
    make_evaluator_config,
    make_request,
    summarize,
)
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import (
    CHECKPOINTS,
    PERCEPTION,
    named_methods,
    needs_renderer,
    other_policies,
)
from readygo.runs.options import WorldOptions
from readygo.runs.origin import avatars_of_policy, check_unseen, unseen_avatars
from readygo.runs.policy import policy_sha256
from readygo.runs.spec import episode_count
from readygo.runs.trained import check_out
from readygo.runs.world import World
from readygo.services.evaluator import (
    EpisodeRecord,
    EvaluateReply,
    EvaluateRequest,
    Results,
    Task,
    handle_evaluate,
    open_results,
    summary_table,
)
from readygo.services.planner import MixName

TaskName = Literal["static", "dynamic", "reactive"]
Show = Callable[[EpisodeRecord], None]
Say = Callable[[str], None]
METHODS = ("policy", "expert", "straight-line")
"""Methods by default; the first one where a policy is named."""


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """Which episodes are driven, and how."""

    from_logs: Path | None = None
    """Folder with logs of `readygo drive --log`, instead of a scene: prints the results of a real robot's trials;
    `labels.toml` in it adds what the logs do not record."""
    split: Literal["train", "val", "test"] = "test"
    """Split that the episodes are drawn from."""
    seed: int = 0
    """Seed of the episodes."""
    unseen: tuple[Literal["avatars", "scenes"], ...] = ()
    """What must be new to the policy, else the command fails: "avatars" uses the test part if the policy's data
    use the training part (at least six avatars there, two here); "scenes"."""
    camera: CameraName = "policy"
    """"policy" uses the camera that the policy was trained with, and rejects a different one in `robot`, `config`
    or `sensor`; "robot" uses the given one."""
    control_hz: float | None = None
    """Rate of the policy's decisions [Hz], by default the robot's control rate; the command is held between
    decisions, and the policy's memory still sees every image."""
    lockstep: int = 8
    """Episodes simulated in parallel."""
    checkpoints: Path = CHECKPOINTS
    """Folder with gnm_large.pth, vint.pth, nomad.pth, the policies vid2sim, rl and others, the network perception, or
    runs of `readygo learn`, for the methods that need them."""


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Drive a policy, the expert and a straight-line baseline through the same episodes, and report success rates.

    With `out`, every episode is saved when it ends. After an interruption the same command resumes, also with more
    episodes, tasks or methods.
    """

    scene: Positional[str] = ""
    """Scene bundle, "embedded", "embedded:SEED" or "embedded:plan-SEED"."""
    policy: Positional[Path | None] = None
    """Folder of a trained policy; without one, only the other methods drive."""
    episodes: int | None = None
    """Episodes per task; by default 100, or the number of entries in the scenario file."""
    tasks: tuple[TaskName, ...] = ("static", "dynamic")
    """"static" has no pedestrians, "dynamic" has pedestrians that ignore the robot, "reactive" has the same
    pedestrians, who avoid the robot."""
    methods: tuple[str, ...] = METHODS
    """Drivers: policy, expert, expert-tracked, expert-paper, expert-oracle (knows all pedestrians' walks), expert-blind
    (sees none), straight-line, social-force, gaussnav, splat-nav,
    perceive-and-plan and perceive-and-act (of the folders perception and rl in `checkpoints`), vid2sim, rl (of
    `readygo rl`), gnm, vint, nomad, further policies by the names of their folders in `checkpoints`, or your class
    as my_package:MyDriver or folder/file.py:MyDriver."""
    out: Path | None = None
    """Folder for episodes.jsonl, trajectories.jsonl, summary.json, videos, and pages with the failures."""
    video: tuple[str, ...] = ()
    """Episodes of the policy to write as videos into `out`: "worst", "failures", "avoided" (goals that it reaches
    where it meets a human when it drives as without humans) or indices, such as worst 17; a later call writes them
    without driving the episodes again."""
    robot: Path | None = None
    """robot.toml; by default the robot in `config`, else the policy's."""
    config: Path | None = None
    """TOML file with sections of settings, as for `readygo generate`; other settings are those of the policy's
    data."""
    people: MixName | None = None
    """Scenario mix: how many pedestrians there are and how they meet the robot; overrides `config`. By default as
    in the policy's data, else "paper"."""
    workers: int = 0
    """Processes that drive, one per core; 0 drives in this process. The results are the same."""
    json: bool = False
    """Print the summary as JSON."""
    trials: TrialOptions = field(default_factory=TrialOptions)
    world: WorldOptions = field(default_factory=WorldOptions)
    fleet: RouterOptions = field(default_factory=RouterOptions)
    keys: EvaluationKeys = field(default_factory=dict)


def evaluate(options: EvaluateOptions) -> None:
    """Drive a policy, the expert and a straight-line baseline through the same episodes, and report success rates."""
    trials, out = options.trials, options.out
    check_counts(1 if options.episodes is None else options.episodes, options.workers)
    if out is not None:
        check_out(out)
    if trials.from_logs is not None:
        if given := given_options(options, ("from_logs", "out", "json")):
            raise RunError(f"--from-logs takes all settings from the logs: leave out {', '.join(given)}.")
        evaluate_logs(trials.from_logs, out, json=options.json)
        return
    if not options.scene:
        raise RunError("Say where: readygo evaluate SCENE POLICY, or --from-logs FOLDER for trials of a real robot.")
    check_wanted(options.video, options.tasks)
    _check_folder(out, options.workers, options.fleet.listen, options.video)
    request = _request(options)
    settings = make_evaluator_config(trials.lockstep)
    policy = load_policy(options.policy) if options.policy else None
    world = _world(options, policy)
    _check_unseen(options, policy, world, request.methods)
    sha256 = policy_sha256(options.policy) if options.policy and out else ""
    hashes = method_hashes(request.methods, trials.checkpoints) if out else {}
    identity = evaluation_settings(world, request, policy=sha256, camera=trials.camera, methods=hashes)
    total = len(request.tasks) * len(request.methods) * request.episodes
    looks = needs_renderer(request.methods, trials.checkpoints) and not options.workers
    renderer = world.renderer() if looks else None
    evaluator = make_evaluator(
        world,
        renderer=renderer,
        policy=policy,
        evaluator_config=settings,
        camera=trials.camera,
        methods=named_methods(world, request.methods, trials.checkpoints, request.hold_steps(world.config.robot.clock)),
    )
    evaluator.check_drivers(request)
    folder = open_results(out, identity) if out else nullcontext()
    with folder as results, _report_saved(results, request, total):
        with episode_progress(PlainConsole(stderr=True), total, quiet=options.json) as (show, say):
            fleet = _fleet(options, world, request, results, hashes, show, say) if options.workers and results else None
            elsewhere = by_fleet(fleet) if fleet else None
            reply = handle_evaluate(evaluator, request, report=show, results=results, elsewhere=elsewhere)
        summary = summarize(reply, request, evaluator) | _settings_said(world.config, identity)
        if results is not None:
            results.finish(summary)
            sees = policy.spec.images if policy else ()
            perception = _perception(options, world) if options.video else None
            replays = Replays(
                world, results, reply.episodes, renderer, evaluator.simulation, sees=sees, perception=perception
            )
            write_films(replays, request, reply, options.video)
            title = f"{options.policy or watched_method(request.methods)} in {world.scene.name}"
            write_pages(replays, request, reply, title=title)
    said = f"Split {request.split.value}, seed {request.seed}; pedestrians: {pedestrians_text(world)}."
    _print(summary, reply, out, said, json=options.json)


def _request(options: EvaluateOptions) -> EvaluateRequest:
    """The episodes to drive and who drives them."""
    return make_request(
        episode_count(options.world.scenarios) if options.episodes is None else options.episodes,
        options.tasks,
        options.methods if options.policy else _without_policy(options.methods),
        Split(options.trials.split),
        options.trials.seed,
        control_hz=options.trials.control_hz,
    )


def _world(options: EvaluateOptions, policy: Policy | None) -> World:
    """Scene, pedestrians and settings of the episodes."""
    camera = options.trials.camera
    trained = policy.spec.robot if policy and camera == "policy" else None
    config = evaluation_config(
        policy.spec if policy else None,
        camera,
        config=options.config,
        robot=load_robot(options.robot, cameras_of=trained) if options.robot else None,
        sensor=options.world.sensor,
        humans=options.people,
        keys=options.keys,
    )
    bodies = _bodies(options.world.avatars, policy, options.trials.unseen)
    return evaluation_world(
        options.scene,
        config,
        avatars=bodies,
        seed=options.trials.seed,
        split=Split(options.trials.split),
        scenarios=options.world.scenarios,
    )


def _check_unseen(options: EvaluateOptions, policy: Policy | None, world: World, methods: Sequence[str]) -> None:
    """Raise an error if a policy's data hold avatars or scenes that must be new to it."""
    unseen = options.trials.unseen
    if policy:
        check_unseen(policy.spec, world.spec, unseen)
        for place in other_policies(methods, options.trials.checkpoints).values():
            check_unseen(load_spec(place), world.spec, unseen)
    elif unseen:
        raise RunError("--unseen is about a policy's data: name the policy.")


def _fleet(
    options: EvaluateOptions,
    world: World,
    request: EvaluateRequest,
    results: Results,
    hashes: dict[str, str],
    show: Show,
    say: Say,
) -> EvaluationFleet:
    """The processes that drive the episodes."""
    trials = options.trials
    return EvaluationFleet(
        spec=fleet_spec(world, options.policy if "policy" in request.methods else None),
        plan=make_plan(
            request,
            camera=trials.camera,
            lockstep=trials.lockstep,
            checkpoints=trials.checkpoints,
            method_hashes=hashes,
        ),
        request=request,
        results=results,
        workers=options.workers,
        listen=options.fleet.listen,
        certs=options.fleet.certs,
        report=show,
        say=say,
    )


def _perception(options: EvaluateOptions, world: World) -> Perception | None:
    """The network whose answers the videos show; None unless it drives."""
    if not set(PERCEIVING) & set(options.methods):
        return None
    return load_perception(options.trials.checkpoints / PERCEPTION, robot=world.config.robot)


def _bodies(avatars: Path | None, policy: Policy | None, unseen: Sequence[str]) -> Path | None:
    """The avatars that the user named, else those of the policy's data."""
    if avatars is not None or policy is None:
        return avatars
    return unseen_avatars(policy.spec) if "avatars" in unseen else avatars_of_policy(policy.spec)


def _check_folder(out: Path | None, workers: int, listen: str, video: Sequence[str]) -> None:
    """Raise RunError for options that need --out without it, and for --listen without workers."""
    if (workers or listen) and out is None:
        raise RunError("--workers keep their records in a folder: say which with --out.")
    if listen and not workers:
        raise RunError("--listen is for workers: say with --workers how many are started here, at least 1.")
    if listen:
        check_endpoint(listen, "--listen")
    if video and out is None:
        raise RunError("--video writes films into a folder: say which with --out.")


def _settings_said(config: RunConfig, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of pedestrians, sensor, detail and scenarios, for the summary."""
    return {
        "human_planner": section_to_mapping(config.human_planner),
        "sensor": section_to_mapping(config.renderer.sensor),
        "detail": config.renderer.detail,
        "scenarios": identity["scenarios"],
    }


def _print(summary: Mapping[str, Any], reply: EvaluateReply, out: Path | None, episodes: str, *, json: bool) -> None:
    if json:
        sys.stdout.write(json_module.dumps(summary) + "\n")
        return
    console = PlainConsole()
    console.print(summary_table(reply.summaries))
    console.print(episodes, markup=False, highlight=False, soft_wrap=True)
    for line in _failed_drivers(reply.records):
        console.print(line, markup=False, soft_wrap=True)
    if out is not None:
        console.print(f"Look at it: {out / REPORT_FILE}", markup=False, soft_wrap=True)


def _failed_drivers(records: Sequence[EpisodeRecord]) -> list[str]:
    """A line for each method whose driver failed, with the first reason."""
    failed: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        if record.reason:
            failed.setdefault(record.method, []).append(record)
    return [
        f"{method} failed in {len(of_method)} episodes, in {of_method[0].episode.episode_id}: {of_method[0].reason}"
        for method, of_method in failed.items()
    ]


def _without_policy(methods: tuple[str, ...]) -> tuple[str, ...]:
    """The methods of a command that names no policy: of the default ones the others."""
    if methods == METHODS:
        return METHODS[1:]
    if "policy" in methods:
        raise RunError("The method `policy` needs a policy: readygo evaluate SCENE POLICY.")
    return methods


@contextmanager
def _report_saved(results: Results | None, request: EvaluateRequest, total: int) -> Iterator[None]:
    """At Ctrl-C, report how many episodes are saved."""
    try:
        yield
    except KeyboardInterrupt:
        if results is None:
            raise KeyboardInterrupt("nothing is kept: with --out every episode is, as it ends.") from None
        kept = sum(task in request.tasks and method in request.methods for task, method, _ in results.records)
        said = f"{min(kept, total)} of {total} episodes are kept in {results.folder}; the same command resumes."
        raise KeyboardInterrupt(said) from None


@contextmanager
def episode_progress(console: PlainConsole, total: int, *, quiet: bool) -> Iterator[tuple[Show, Say]]:
    """Show the progress of episodes, with the success rate of the driver and task that ended last.

    Args:
        console: Where to show it.
        total: Number of episodes.
        quiet: True shows nothing.

    Yields:
        Functions to call with each record, and with lines to print above the bar.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with SteadyProgress(*columns, console=console, quiet=quiet) as progress:
        task = progress.add_task("episodes", total=total, rate="")
        outcomes: dict[tuple[Task, str], list[bool]] = {}

        def show(record: EpisodeRecord) -> None:
            of_group = outcomes.setdefault((record.task, record.method), [])
            of_group.append(record.result.outcome.value == "success")
            rate = f"{record.task.value} {record.method}: SR {100 * sum(of_group) / len(of_group):.0f} %, ETA"
            progress.update(task, advance=1, rate=rate)

        def say(line: str) -> None:
            progress.console.print(line, markup=False, highlight=False, soft_wrap=True)

        yield show, say
