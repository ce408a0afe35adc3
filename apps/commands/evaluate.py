"""`readygo evaluate`: success rates in closed loop."""

import json as json_module
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.run.evaluation import (
    CameraName,
    evaluation_config,
    make_evaluator,
    make_evaluator_config,
    make_request,
    summarize,
)
from readygo.apps.run.origin import avatars_of_policy
from readygo.apps.run.spec import episode_count
from readygo.common.config import section_to_mapping
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.common.policy import load_policy
from readygo.common.robot import load_robot
from readygo.services.evaluator import EpisodeRecord, Method, Task, handle_evaluate, summary_table, write_results
from readygo.services.planner.humans.mixes import MixName
from readygo.services.planner.humans.scenario_file import read_text, text_hash
from readygo.services.renderer.sensor.recipes import SensorName

TaskName = Literal["static", "dynamic"]
MethodName = Literal["policy", "expert", "straight-line"]
Show = Callable[[EpisodeRecord], None]


def evaluate(
    scene: str,
    policy: Path | None = None,
    /,
    *,
    episodes: int | None = None,
    tasks: tuple[TaskName, ...] = ("static", "dynamic"),
    methods: tuple[MethodName, ...] = ("policy", "expert", "straight-line"),
    split: Literal["train", "val", "test"] = "test",
    seed: int = 0,
    out: Path | None = None,
    avatars: Path | None = None,
    robot: Path | None = None,
    config: Path | None = None,
    sensor: SensorName | None = None,
    camera: CameraName = "policy",
    people: MixName | None = None,
    scenarios: Path | None = None,
    control_hz: float = 20.0,
    lockstep: int = 8,
    json: bool = False,
) -> None:
    """Drive a policy, the expert and a straight line through the same episodes, and count successes.

    Args:
        scene: Scene bundle, or "embedded".
        policy: Folder of a trained policy; without one only the other methods drive.
        episodes: Episodes per task; 100, or as many as the scenario file has entries.
        tasks: "static" leaves the humans out, "dynamic" lets them walk.
        methods: Who drives.
        split: Random streams to draw the episodes from.
        seed: Seed of the episodes.
        out: Folder for episodes.jsonl and summary.json.
        avatars: Avatar file or folder of them; those of the policy's data by default, else the embedded ones.
        robot: robot.toml; by default the one in `config`, else the policy's robot.
        config: TOML file with sections of settings, as given to `readygo generate`; what it does not name is as in the
            policy's data.
        sensor: Recipe of the camera's lens, light and shutter and of what varies of them, in place of what robot and
            `config` say of that.
        camera: "policy" looks through the camera that the policy was trained with, and refuses another one of `robot`,
            `config` or `sensor`; "robot" takes that one.
        people: Recipe of how many people come and how they meet the robot, in place of what `config` says of it; as in
            the policy's data by default, else "paper".
        scenarios: TOML file with starts, goals and people to play instead of drawing them, one entry after the other.
        control_hz: How often the policy decides [Hz]; its command is held in between, its memory sees every image.
        lockstep: Episodes that run side by side.
        json: Print the summary as JSON.
    """
    count = episode_count(scenarios) if episodes is None else episodes
    drivers = methods if policy else _without_policy(methods)
    request = make_request(count, tasks, drivers, Split(split), seed, control_hz=control_hz)
    loaded = load_policy(policy) if policy else None
    if loaded and avatars is None:
        avatars = avatars_of_policy(loaded.spec)
    trained_camera = loaded.spec.robot.camera if loaded and camera == "policy" else None
    run_config = evaluation_config(
        loaded.spec if loaded else None,
        camera,
        config=config,
        robot=load_robot(robot, camera=trained_camera) if robot else None,
        sensor=sensor,
        humans=people,
    )
    evaluator = make_evaluator(
        scene,
        run_config,
        avatars=avatars,
        seed=seed,
        policy=loaded,
        evaluator_config=make_evaluator_config(lockstep),
        scenarios=scenarios,
        camera=camera,
    )
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    total = len(request.tasks) * len(request.methods) * request.episodes
    with _progress(Console(stderr=True), total, quiet=json) as show:
        reply = handle_evaluate(evaluator, request, report=show)
    summary = summarize(reply, request, evaluator)
    summary["human_planner"] = section_to_mapping(run_config.human_planner)
    summary["sensor"] = section_to_mapping(run_config.renderer.sensor)
    summary["detail"] = run_config.renderer.detail
    summary["scenarios"] = text_hash(read_text(scenarios)) if scenarios else ""
    if out is not None:
        write_results(out, reply.records, summary)
    if json:
        sys.stdout.write(json_module.dumps(summary) + "\n")
        return
    console = Console(highlight=False)
    console.print(summary_table(reply.summaries))
    if out is not None:
        console.print(f"Every episode: {out / 'episodes.jsonl'}", markup=False)


def _without_policy(methods: tuple[MethodName, ...]) -> tuple[MethodName, ...]:
    others = tuple(method for method in methods if method != "policy")
    if methods and not others:
        raise RunError("The method `policy` needs a policy: readygo evaluate SCENE POLICY.")
    return others


@contextmanager
def _progress(console: Console, total: int, *, quiet: bool) -> Iterator[Show]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with SteadyProgress(*columns, console=console, quiet=quiet) as progress:
        task = progress.add_task("episodes", total=total, rate="")
        outcomes: dict[tuple[Task, Method], list[bool]] = {}

        def show(record: EpisodeRecord) -> None:
            of_group = outcomes.setdefault((record.task, record.method), [])
            of_group.append(record.result.outcome.value == "success")
            rate = f"{record.task.value} {record.method.value}: SR {100 * sum(of_group) / len(of_group):.0f} %, ETA"
            progress.update(task, advance=1, rate=rate)

        yield show
