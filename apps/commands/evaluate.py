"""`readygo evaluate`: success rates in closed loop."""

import json as json_module
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from readygo.apps.commands.evaluate_logs import evaluate_logs
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.evaluation.replay import Replays
from readygo.apps.evaluation.watch import check_wanted, watched_method, write_films, write_pages
from readygo.apps.fleet.evaluation import EvaluationFleet, by_fleet, fleet_spec, make_plan
from readygo.apps.report.evaluation import REPORT_FILE
from readygo.apps.run.config import RunConfig
from readygo.apps.run.evaluation import (
    CameraName,
    evaluation_config,
    evaluation_settings,
    evaluation_world,
    make_evaluator,
    make_evaluator_config,
    make_request,
    summarize,
)
from readygo.apps.run.method_files import method_hashes
from readygo.apps.run.methods import CHECKPOINTS, named_methods, needs_renderer, other_policies
from readygo.apps.run.origin import avatars_of_policy, check_unseen, unseen_avatars
from readygo.apps.run.policy import policy_sha256
from readygo.apps.run.spec import episode_count
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.config import section_to_mapping
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.common.policy import Policy, load_policy, load_spec
from readygo.common.robot import load_robot
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
from readygo.services.planner.humans.mixes import MixName
from readygo.services.renderer import SensorName

TaskName = Literal["static", "dynamic", "reactive"]
Show = Callable[[EpisodeRecord], None]
Say = Callable[[str], None]


def evaluate(
    scene: str = "",
    policy: Path | None = None,
    /,
    *,
    from_logs: Path | None = None,
    episodes: int | None = None,
    tasks: tuple[TaskName, ...] = ("static", "dynamic"),
    methods: tuple[str, ...] = ("policy", "expert", "straight-line"),
    split: Literal["train", "val", "test"] = "test",
    seed: int = 0,
    out: Path | None = None,
    video: tuple[str, ...] = (),
    avatars: Path | None = None,
    unseen: tuple[Literal["avatars", "scenes"], ...] = (),
    robot: Path | None = None,
    config: Path | None = None,
    sensor: SensorName | None = None,
    camera: CameraName = "policy",
    people: MixName | None = None,
    scenarios: Path | None = None,
    control_hz: float | None = None,
    lockstep: int = 8,
    checkpoints: Path = CHECKPOINTS,
    workers: int = 0,
    listen: str = "",
    certs: Path | None = None,
    json: bool = False,
) -> None:
    """Drive a policy, the expert and a straight-line baseline through the same episodes, and report success rates.

    With `out`, every episode is saved when it ends. After an interruption the same command resumes, also with more
    episodes, tasks or methods.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        policy: Folder of a trained policy; without one, only the other methods drive.
        from_logs: Folder with logs of `readygo drive --log`, instead of a scene: prints the results of a real robot's
            trials; `labels.toml` in it adds what the logs do not record.
        episodes: Episodes per task; by default 100, or the number of entries in the scenario file.
        tasks: "static" has no pedestrians, "dynamic" has pedestrians that ignore the robot, "reactive" has the same
            pedestrians, who avoid the robot.
        methods: Drivers: policy, expert, expert-paper, straight-line, social-force, gaussnav, splat-nav, vid2sim, gnm,
            vint, nomad, further policies by the names of their folders in `checkpoints`, or your class as
            my_package:MyDriver or folder/file.py:MyDriver.
        split: Split that the episodes are drawn from.
        seed: Seed of the episodes.
        out: Folder for episodes.jsonl, trajectories.jsonl, summary.json, videos, and pages with the failures.
        video: Episodes of the policy to write as videos into `out`: "worst", "failures" or indices, such as worst 17; a
            later call writes them without driving the episodes again.
        avatars: Avatar file or folder of avatars; by default those of the policy's data, else the embedded ones. The
            suffix ":train" or ":test", also after "embedded", selects one part.
        unseen: What must be new to the policy, else the command fails: "avatars" uses the test part if the policy's
            data use the training part (at least six avatars there, two here); "scenes".
        robot: robot.toml; by default the robot in `config`, else the policy's.
        config: TOML file with sections of settings, as for `readygo generate`; other settings are those of the policy's
            data.
        sensor: Recipe of the camera's lens, light and shutter and of their variation; overrides robot and `config`.
        camera: "policy" uses the camera that the policy was trained with, and rejects a different one in `robot`,
            `config` or `sensor`; "robot" uses the given one.
        people: Scenario mix: how many pedestrians there are and how they meet the robot; overrides `config`. By default
            as in the policy's data, else "paper".
        scenarios: TOML file with starts, goals and pedestrians to play in order, instead of drawn ones.
        control_hz: Rate of the policy's decisions [Hz], by default the robot's control rate; the command is held
            between decisions, and the policy's memory still sees every image.
        lockstep: Episodes simulated in parallel.
        checkpoints: Folder with gnm_large.pth, vint.pth, nomad.pth, the policy vid2sim and others, or runs of
            `readygo learn`, for the methods that need them.
        workers: Processes that drive, one per core; 0 drives in this process. The results are the same.
        listen: Endpoint of the workers' router, such as tcp/127.0.0.1:7447, for workers that you start by hand or on
            other machines (`readygo worker evaluator`); a free loopback port by default.
        certs: Folder with certificates of coordinator and evaluator (`readygo certs issue`), for a tls/ endpoint.
        json: Print the summary as JSON.
    """
    if from_logs is not None:
        evaluate_logs(from_logs, out, json=json)
        return
    if not scene:
        raise RunError("Say where: readygo evaluate SCENE POLICY, or --from-logs FOLDER for trials of a real robot.")
    check_wanted(video)
    _check_folder(out, workers, listen, video)
    count = episode_count(scenarios) if episodes is None else episodes
    drivers = methods if policy else _without_policy(methods)
    request = make_request(count, tasks, drivers, Split(split), seed, control_hz=control_hz)
    settings = make_evaluator_config(lockstep)
    loaded = load_policy(policy) if policy else None
    trained = loaded.spec.robot if loaded and camera == "policy" else None
    run_config = evaluation_config(
        loaded.spec if loaded else None,
        camera,
        config=config,
        robot=load_robot(robot, cameras_of=trained) if robot else None,
        sensor=sensor,
        humans=people,
    )
    bodies = _bodies(avatars, loaded, unseen)
    world = evaluation_world(scene, run_config, avatars=bodies, seed=seed, split=request.split, scenarios=scenarios)
    if loaded:
        check_unseen(loaded.spec, world.spec, unseen)
        for place in other_policies(drivers, checkpoints).values():
            check_unseen(load_spec(place), world.spec, unseen)
    elif unseen:
        raise RunError("--unseen is about a policy's data: name the policy.")
    sha256 = policy_sha256(policy) if policy and out else ""
    hashes = method_hashes(drivers, checkpoints) if out else {}
    identity = evaluation_settings(world, request, policy=sha256, camera=camera, methods=hashes)
    total = len(request.tasks) * len(request.methods) * request.episodes
    folder = open_results(out, identity) if out else nullcontext()
    with folder as results, _kept(results, request, total):
        renderer = world.renderer() if needs_renderer(drivers) and not workers else None
        evaluator = make_evaluator(
            world,
            renderer=renderer,
            policy=loaded,
            evaluator_config=settings,
            camera=camera,
            methods=named_methods(world, drivers, checkpoints, request.hold_steps(world.config.robot.clock)),
        )
        with _progress(PlainConsole(stderr=True), total, quiet=json) as (show, say):
            elsewhere = None
            if workers and results is not None:
                fleet = EvaluationFleet(
                    spec=fleet_spec(world, policy if "policy" in drivers else None),
                    plan=make_plan(
                        request, camera=camera, lockstep=lockstep, checkpoints=checkpoints, method_hashes=hashes
                    ),
                    request=request,
                    results=results,
                    workers=workers,
                    listen=listen,
                    certs=certs,
                    report=show,
                    say=say,
                )
                elsewhere = by_fleet(fleet)
            reply = handle_evaluate(evaluator, request, report=show, results=results, elsewhere=elsewhere)
        summary = summarize(reply, request, evaluator) | _settings_said(run_config, identity)
        if results is not None:
            results.finish(summary)
            sees = loaded.spec.images if loaded else ()
            replays = Replays(world, results, reply.episodes, renderer, evaluator.simulation, sees=sees)
            write_films(replays, request, reply, video)
            title = f"{policy or watched_method(request.methods)} in {world.scene.name}"
            write_pages(replays, request, reply, title=title)
    _print(summary, reply, out, json=json)


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


def _print(summary: Mapping[str, Any], reply: EvaluateReply, out: Path | None, *, json: bool) -> None:
    if json:
        sys.stdout.write(json_module.dumps(summary) + "\n")
        return
    console = PlainConsole()
    console.print(summary_table(reply.summaries))
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
    others = tuple(method for method in methods if method != "policy")
    if methods and not others:
        raise RunError("The method `policy` needs a policy: readygo evaluate SCENE POLICY.")
    return others


@contextmanager
def _kept(results: Results | None, request: EvaluateRequest, total: int) -> Iterator[None]:
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
def _progress(console: PlainConsole, total: int, *, quiet: bool) -> Iterator[tuple[Show, Say]]:
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
