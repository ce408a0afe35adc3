"""`readygo learn`: record data in a scene and train a policy on them at the same time."""

import json as json_module
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, TaskProgressColumn, TextColumn

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.fleet.access import identity_for
from readygo.apps.learn.config import GoalName
from readygo.apps.learn.crew import Reach
from readygo.apps.learn.learn import learn_policy, report_content
from readygo.apps.learn.plan import Budget, Plan, learn_configs, make_plan
from readygo.apps.learn.supervise import Now
from readygo.apps.monitor.beside import watched
from readygo.apps.report.learn import write_report
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.identity import COORDINATOR
from readygo.common.errors import RunError
from readygo.services.evaluator import EpisodeRecord, summary_table

Show = Callable[[Now], None]
Tested = Callable[[EpisodeRecord], None]


def learn(
    scenes: tuple[str, ...],
    /,
    *,
    out: Path,
    minutes: float = 60.0,
    samples: int | None = None,
    episodes: int = 100,
    seed: int = 0,
    avatars: Path | None = None,
    robot: Path | None = None,
    config: Path | None = None,
    inputs: str = "",
    cameras: str = "",
    goal: GoalName | None = None,
    on: Literal["local", "hosts"] = "local",
    listen: str = "",
    certs: Path | None = None,
    watch: bool = False,
    json: bool = False,
) -> None:
    """Record episodes and train a policy at the same time; run the same command again to resume.

    First the expert drives, with noise injection. Then DAgger: the current policy drives most episodes, and the expert
    labels every sample. The policy with the best success rate on the split val is kept and evaluated on the split test.

    Args:
        scenes: Scene bundles, "embedded" or "embedded:SEED"; one policy learns in all of them.
        out: Folder of the run, new or to resume: data, policy, curve.json, evaluation and report.html.
        minutes: Wall time of recording and training, including earlier calls [min]; training ends earlier if the policy
            stops improving. The test is not included.
        samples: Training budget in samples, repeats counted, instead of minutes: the result depends less on the
            machine's load.
        episodes: Test episodes per task and scene, each driven by the policy, the expert and a straight-line baseline;
            0: no test.
        seed: Seed of the episodes and of the training.
        avatars: Avatar file or folder of avatars; the embedded ones by default.
        robot: robot.toml; without a camera in it, or without the file, the camera has 72x128 pixels.
        config: TOML file with sections of settings, as for `readygo generate`, and [learn]: `mix`, the policy fraction
            of the episodes, `reuse`, how often each sample is used for training, and others.
        inputs: Images that the policy uses and that are recorded, separated by commas: rgb, depth; rgb by default.
        cameras: Cameras of the robot that the policy uses, by their names in robot.toml, including the first one; only
            the first one by default.
        goal: Goal input of the policy: "point" (the default) is its position, "image" the robot's view at the goal, or
            "both".
        on: Where episodes are driven: "local" shares this machine's cores between driving and training; "hosts" uses
            them for training only, and `readygo worker all` drives on other machines.
        listen: Endpoint of the fleet's router, for workers on other machines, such as tls/10.0.0.5:7447.
        certs: Folder with certificates of coordinator, recorder.rec0, trainer and all, for a tls/ endpoint.
        watch: Show the run live on a web page, as `readygo monitor` does.
        json: Print the result as JSON.
    """
    if episodes < 0:
        raise RunError(f"--episodes must be at least 0, got {episodes}.")
    if on == "hosts" and not listen:
        raise RunError("--on hosts needs --listen with an address that they reach, such as tls/10.0.0.5:7447.")
    if listen or certs:
        # Check certificates before any work is done.
        identity_for(listen, COORDINATOR, certs=certs)
    plan = make_plan(
        scenes,
        out,
        *learn_configs(config, robot, inputs, cameras, goal, scene_count=max(len(scenes), 1)),
        Budget(minutes=minutes, samples=samples),
        avatars=avatars,
        seed=seed,
    )
    if listen:
        sys.stderr.write(f"{_how_to_join(plan, listen, certs)}\n")
    reach = Reach(listen=listen, certs=certs, hosts=on == "hosts")
    page = watched(out, partial(_has_begun, plan), certs) if watch else nullcontext()
    with page, live_line(6 * episodes * len(scenes), quiet=json) as (show, tested):
        learned = learn_policy(plan, episodes=episodes, show=show, tested=tested, reach=reach)
    report = out / "report.html"
    named = {"avatars": avatars, "robot": robot, "config": config, "seed": seed or None}
    write_report(report, report_content(learned, scenes, **named))
    if json:
        sys.stdout.write(json_module.dumps(learned.to_mapping()) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    for name, reply in learned.replies.items():
        console.print(name, markup=False)
        console.print(summary_table(reply.summaries))
    console.print(f"The policy: {plan.policy}. How it learned and what it fails in: {report}", markup=False)


def _how_to_join(plan: Plan, listen: str, certs: Path | None) -> str:
    proof = "" if certs else f"READYGO_TOKEN=$(tail -1 {plan.places[0].folder.state / 'endpoint'}) "
    return f"More workers can join: {proof}readygo worker all --connect {listen}{' --certs CERTS' if certs else ''}"


def _has_begun(plan: Plan) -> bool:
    return all((place.folder.state / "endpoint").exists() for place in plan.places)


@contextmanager
def live_line(tested_total: int, *, quiet: bool = False) -> Iterator[tuple[Show, Tested]]:
    """Show the progress of training and then of the test on the terminal; `quiet` shows nothing."""
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn(), TextColumn("{task.fields[said]}"))
    with SteadyProgress(*columns, quiet=quiet) as progress:
        task = progress.add_task("learning", total=1.0, said="starting")

        def show(now: Now) -> None:
            progress.update(task, completed=now.fraction, said=line_of(now))

        testing = progress.add_task("test", total=tested_total, said="", visible=False)

        def tested(record: EpisodeRecord) -> None:
            progress.update(testing, advance=1, visible=True, said=f"{record.task.value}, {record.method}")

        yield show, tested


def line_of(now: Now) -> str:
    """Progress of a training run in one line: times, sample counts and success rates."""
    times = f" ({now.learned / now.images:.1f} times each)" if now.images and now.learned else ""
    parts = [
        f"{now.minutes:.1f} min",
        f"{now.samples:,} samples recorded",
        f"{now.images:,} with an image",
        f"{now.learned:,} learned from{times}",
        f"{now.policies} policies",
    ]
    if now.driven is not None:
        parts.append(f"driving SR {100 * now.driven:.0f} %")
    if now.latest is not None:
        parts.append(f"val SR {100 * now.latest.static:.0f} / {100 * now.latest.dynamic:.0f} %")
    return ", ".join(parts)
