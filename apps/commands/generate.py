"""`readygo generate`: record a dataset in a scene."""

import json as json_module
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from readygo.apps.cli import Bare, Group
from readygo.apps.commands.coordinator import check_endpoints, lead_run, report_set_aside
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.fleet.run import Show, begin, check_counts, record
from readygo.apps.fleet.slurm import check_slurm
from readygo.apps.monitor.beside import watched
from readygo.apps.observe.logs import LogFormat
from readygo.apps.observe.settings import NOTHING, OBSERVING, Observing
from readygo.apps.run.again import prepare_again
from readygo.apps.run.config import (
    RunConfig,
    load_run_config,
    with_detail,
    with_disturbance,
    with_outputs,
    with_priority,
)
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.origin import avatars_of_policy, robot_of_policy
from readygo.apps.run.policy import with_expert, with_policy
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.run.spec import episode_count, make_spec
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import run_clarity
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import RunError
from readygo.common.messages import RunSpec, Split, StatusReply
from readygo.common.policy import load_spec
from readygo.common.robot import load_robot
from readygo.services.planner.humans.mixes import MixName
from readygo.services.renderer import SensorName

Detail = Literal["exact", "lod"]
Place = Literal["local", "slurm", "hosts"]
HUMANS, DRIVING, IMAGES, RUNNING = (Group(name) for name in ("humans", "driving", "images", "running"))


def generate(
    scene: str = "",
    /,
    *,
    out: Path,
    episodes: int | None = None,
    workers: Annotated[int, RUNNING] = 1,
    split: Literal["train", "val", "test"] = "train",
    seed: int = 0,
    avatars: Annotated[Path | None, HUMANS] = None,
    static: Annotated[bool, HUMANS] = False,
    people: Annotated[MixName | None, HUMANS] = None,
    scenarios: Annotated[Path | None, HUMANS] = None,
    policy: Annotated[Path | None, DRIVING] = None,
    mix: Annotated[float | None, DRIVING] = None,
    disturb: Annotated[float | None, Bare("0.5"), DRIVING] = None,
    again: Path | None = None,
    outputs: Annotated[str, IMAGES] = "",
    detail: Annotated[Detail | None, IMAGES] = None,
    robot: Annotated[Path | None, DRIVING] = None,
    config: Path | None = None,
    sensor: Annotated[SensorName | None, IMAGES] = None,
    listen: Annotated[str, RUNNING] = "",
    connect: Annotated[str, RUNNING] = "",
    priority: Annotated[int | None, RUNNING] = None,
    certs: Annotated[Path | None, RUNNING] = None,
    on: Annotated[Place, RUNNING] = "local",
    slurm: Annotated[str, RUNNING] = "",
    watch: Annotated[bool, RUNNING] = False,
    strict: Annotated[bool, RUNNING] = False,
    json: Annotated[bool, RUNNING] = False,
    metrics: Annotated[str, OBSERVING] = "",
    log_format: Annotated[LogFormat, OBSERVING] = "text",
) -> None:
    """Record episodes of a robot among pedestrians in a scene; run the same command again to resume.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        out: Data folder for the shards.
        episodes: Episodes to record; by default 100, or the number of entries in the scenario file.
        workers: Renderer processes, or driver processes with a policy, in addition to one process for each other role;
            0 does everything in this process.
        split: Split of the episodes; train, val and test never share an episode.
        seed: Seed of the run.
        avatars: Avatar file or folder of avatars; by default those of the policy's data, else the embedded ones. The
            suffix ":train" or ":test", also after "embedded", selects one part.
        static: Record without pedestrians.
        people: Scenario mix: how many pedestrians there are and how they meet the robot; overrides `config`. "paper" by
            default.
        scenarios: TOML file with starts, goals and pedestrians to play in order, instead of drawn ones.
        policy: Folder of a trained policy for DAgger: the policy or the expert drives, every sample has expert labels,
            and failed episodes are kept. The robot is the policy's unless `robot` or `config` names one.
        mix: Policy fraction: share of the episodes that the policy drives, 0..1; 0.5 by default.
        disturb: Noise injection (DART): share of the expert's episodes with perturbed motion and actuation delay, 0..1;
            0.5 without a number. The data then show how to recover, every sample has expert labels, and failed
            episodes are kept.
        again: Data folder whose episodes are recorded again, each driven by the same policy as before; `scene` and the
            settings of the run come from there.
        outputs: Images to record, separated by commas: rgb, depth, median_depth, alpha, mask, normal, such as
            rgb,depth,mask; only rgb by default.
        detail: Level of detail: "lod" draws distant objects and pedestrians with fewer Gaussians, about twice as fast;
            by default as in `config`, else "exact".
        robot: robot.toml of a different robot.
        config: TOML file with sections of settings.
        sensor: Recipe of the camera's lens, light and shutter and of their variation; overrides robot and `config`.
        listen: Endpoint of the fleet's router, such as tcp/127.0.0.1:7447, for workers that you start by hand; a free
            loopback port by default.
        connect: Endpoint of a running router (`readygo router`) that several runs share, instead of `listen`; only with
            `on` "hosts".
        priority: Priority of this run, -1000..1000: workers of several runs serve higher ones first; as in `config`, or
            0.
        certs: Folder of certificates (`readygo certs issue`), for a tls/ endpoint.
        on: Where workers run. "local": on this machine. "slurm": submits one array of `workers` jobs, which do all
            stages and are requeued after preemption; `listen` must be an address that the nodes reach, with tls/ or on
            a trusted network. "hosts": starts no workers and no recorder; you start them on other machines with
            `readygo worker`, and `readygo coordinator` resumes the run if this command ends.
        slurm: Options of sbatch, such as "--partition=short --time=2:00:00".
        watch: Show the run live on a web page, as `readygo monitor` does.
        strict: Exit with 2 if an episode was set aside: it failed repeatedly, and the next index replaced it.
        json: Print the summary as JSON.
        metrics: HOST:PORT of this process's Prometheus endpoint; the other processes use the same HOST, each with its
            own port; .readygo/targets in the data folder lists all of them.
        log_format: "json" writes one JSON object per line, with run, worker, stage, episode and attempt.
    """
    check_counts(1 if episodes is None else episodes, workers)
    _check_where(on, workers, listen=listen, connect=connect, slurm=slurm, watch=watch)
    where = Where(
        workers=workers,
        endpoint=listen or connect,
        joins=bool(connect),
        priority=priority,
        slurm=slurm if on == "slurm" else None,
        certs=certs,
        hosts=on == "hosts",
        watch=watch,
        strict=strict,
        observing=Observing(metrics=metrics, log_format=log_format),
    )
    where.observing.check_installed()
    if again is not None:
        if scene:
            raise RunError("--again has the scene of the run that it makes again: name one of the two.")
        spec, wanted = prepare_again(again, out)
        _record(spec, out, wanted, where, json=json)
        return
    if not scene:
        raise RunError('Name a scene: a bundle, or "embedded".')
    if mix is not None and policy is None:
        raise RunError("--mix is the share of a policy's episodes: name the policy with --policy.")
    trained = load_spec(policy) if policy else None
    base = robot_of_policy(trained) if trained else None
    run_config = load_run_config(config, load_robot(robot) if robot else None, sensor, people, base=base)
    run_config = _as_told(run_config, outputs, detail, disturb)
    if trained and not (avatars or static):
        avatars = avatars_of_policy(trained)
    spec = make_spec(
        open_scene(scene), avatars, run_config, seed=seed, split=Split(split), static=static, scenarios=scenarios
    )
    if policy is not None:
        spec = with_policy(spec, run_config, policy, 0.5 if mix is None else mix)
    elif disturb is not None or run_config.driver.disturbed:
        spec = with_expert(spec)
    wanted = episode_count(scenarios) if episodes is None else episodes
    _record(spec, out, wanted, where, json=json)


@dataclass(frozen=True, kw_only=True)
class Where:
    """Number and location of a run's workers, and how they connect."""

    workers: int
    endpoint: str
    """Endpoint of the router; empty for a free loopback port."""
    joins: bool
    """True if the run joins a router that runs already."""
    priority: int | None
    slurm: str | None
    certs: Path | None
    hosts: bool
    """True if all workers and recorders are on other machines."""
    watch: bool = False
    strict: bool = False
    """True if an episode that was set aside is a failure."""
    observing: Observing = NOTHING


def _check_where(on: Place, workers: int, *, listen: str, connect: str, slurm: str, watch: bool) -> None:
    """Check that the options of workers and endpoints fit together.

    Raises:
        RunError: If some contradict each other.
        ConfigError: If an endpoint is malformed.
    """
    for option, endpoint in (("--listen", listen), ("--connect", connect)):
        if endpoint:
            check_endpoint(endpoint, option)
    if on == "slurm":
        check_slurm(workers, listen)
    elif slurm:
        raise RunError("--slurm has options of sbatch: it goes with --on slurm.")
    elif on == "hosts":
        check_endpoints(listen, connect)
    if connect and on != "hosts":
        raise RunError("--connect is for a run whose workers and recorders are on other machines: add --on hosts.")
    if watch and workers == 0 and on != "hosts":
        raise RunError("--watch needs a fleet to hear: give --workers 1 or more.")


def _as_told(config: RunConfig, outputs: str, detail: Detail | None, disturb: float | None) -> RunConfig:
    """The run's settings, overridden by the options that were given."""
    if outputs:
        config = with_outputs(config, outputs)
    if detail:
        config = with_detail(config, detail)
    return config if disturb is None else with_disturbance(config, disturb)


def _record(spec: RunSpec, out: Path, episodes: int, where: Where, *, json: bool) -> None:
    """Record a run, and print its progress and its summary."""
    if where.priority is not None:
        spec = with_priority(spec, where.priority)
    join = _how_to_join(spec, out, where) if where.endpoint else ""
    page = watched(out, (RunFolder(out).state / "endpoint").exists, where.certs) if where.watch else nullcontext()
    if where.hosts:
        begin(spec, out, episodes)
        sys.stderr.write(f"{join}\n")
        with page:
            lead_run(
                RunFolder(out),
                where.endpoint,
                joins=where.joins,
                certs=where.certs,
                strict=where.strict,
                observing=where.observing,
            )
        return
    with page, progress_bar(first_words=join, quiet=json) as show:
        summary = record(
            spec,
            out,
            episodes=episodes,
            workers=where.workers,
            listen=where.endpoint,
            slurm=where.slurm,
            certs=where.certs,
            show=show,
            observing=where.observing,
        )
    clarity = run_clarity(spec, out)
    if json:
        sys.stdout.write(json_module.dumps({**summary, "clarity": clarity.to_mapping()}) + "\n")
        report_set_aside(out, strict=where.strict)
        return
    console = PlainConsole(stderr=True, soft_wrap=True)
    console.print(
        f"{summary['episodes']:,} episodes, {summary['samples']:,} samples in {out} ({summary['wall_s']:.1f} s)."
    )
    for reason, count in summary["rejected"].items():
        console.print(f"  rejected {count}: {reason}", markup=False)
    for text in clarity.warnings():
        console.print(f"Warning: {text}", markup=False)
    report_set_aside(out, strict=where.strict)
    console.print(f"Next: readygo validate {out} && readygo train {out} --out policy", markup=False)
    console.print(f"What it covers: readygo coverage {out} --out coverage", markup=False)


def _how_to_join(spec: RunSpec, out: Path, where: Where) -> str:
    proof = f"READYGO_TOKEN=$(tail -1 {RunFolder(out).state / 'endpoint'}) "
    command = f"readygo worker {spec.stages[-1].role} --connect {where.endpoint} --run {spec.run}"
    return f"More workers can join: {f'{command} --certs CERTS' if where.certs else proof + command}"


@contextmanager
def progress_bar(*, first_words: str = "", quiet: bool = False) -> Iterator[Show]:
    """Print `first_words`, then show a run's progress on the terminal; `quiet` shows nothing."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.0f} samples/s, {task.fields[rejected]} rejected, ETA"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[trouble]}"),
    )
    begin_s = time.monotonic()
    samples_before: int | None = None
    with SteadyProgress(*columns, quiet=quiet) as progress:
        task = progress.add_task("episodes", total=None, rate=0.0, rejected=0, trouble="")

        def show(status: StatusReply) -> None:
            nonlocal samples_before
            if samples_before is None:
                samples_before = status.samples
                if first_words:
                    progress.console.print(first_words, markup=False, highlight=False, soft_wrap=True)
            rate = (status.samples - samples_before) / max(time.monotonic() - begin_s, 1e-3)
            rejected = sum(status.rejected.values())
            fields = {"rate": rate, "rejected": rejected, "trouble": status.trouble}
            progress.update(task, total=status.wanted, completed=status.committed, **fields)

        yield show
