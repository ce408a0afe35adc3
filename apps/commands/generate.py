"""`readygo generate`: record a dataset in a scene."""

import json as json_module
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Positional

from readygo.apps.commands.coordinator import check_endpoints, lead_run, report_set_aside
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.fleet.access import how_to_join
from readygo.apps.fleet.options import FleetOptions
from readygo.apps.fleet.run import LAUNCHER, Show, begin, check_counts, record
from readygo.apps.fleet.slurm import check_slurm
from readygo.apps.monitor.beside import show_page
from readygo.apps.observe.logs import begin_logging
from readygo.apps.observe.settings import Observing
from readygo.apps.options import given_options
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import run_clarity
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import RunError
from readygo.common.messages import RunSpec, Split, StatusReply
from readygo.common.policy import load_spec
from readygo.common.robot import load_robot
from readygo.runs.again import prepare_again
from readygo.runs.config import RunKeys, load_run_config, with_run_keys
from readygo.runs.folder import RunFolder
from readygo.runs.options import WorldOptions
from readygo.runs.origin import avatars_of_policy, robot_of_policy
from readygo.runs.policy import with_expert, with_policy
from readygo.runs.scene_argument import NO_SCENE, open_scene
from readygo.runs.sections import merge_tables
from readygo.runs.spec import episode_count, make_spec
from readygo.runs.teacher import with_teacher
from readygo.services.planner import MixName

Place = Literal["local", "slurm", "hosts"]
_WITH_AGAIN = ("again", "out", "workers", "watch", "json", "fleet", "place", "observe", "coordinator")
"""Fields, groups and sections of settings that go with the repetition of a recorded run."""


@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """Which episodes are recorded, and who drives."""

    split: Literal["train", "val", "test"] = "train"
    """Split of the episodes; train, val and test never share an episode."""
    static: bool = False
    """Record without pedestrians."""
    mix: float | None = None
    """Policy fraction: share of the episodes that the policy drives, 0..1; 0.5 by default."""
    teacher: Path | None = None
    """Folder of a state policy for this robot, from `readygo rl`: it labels every sample instead of the expert, and
    drives the expert's episodes. Or "expert-tracked": the expert that knows people by tracks of simulated
    detections."""
    again: Path | None = None
    """Data folder whose episodes are recorded again, each driven by the same policy as before; `scene` and the
    settings of the run come from there."""


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Where the workers run."""

    on: Place = "local"
    """Where workers run. "local": on this machine. "slurm": submits one array of `workers` jobs, which do all
    stages and are requeued after preemption; `listen` must be an address that the nodes reach, with tls/ or on a
    trusted network. "hosts": starts no workers and no recorder; you start them on other machines with `readygo
    worker`, and `readygo coordinator` resumes the run if this command ends."""
    slurm: str = ""
    """Options of sbatch, such as "--partition=short --time=2:00:00"."""
    strict: bool = False
    """Exit with 2 if an episode was set aside: it failed repeatedly, and the next index replaced it."""


@dataclass(frozen=True, kw_only=True)
class GenerateOptions:
    """Record episodes of a robot among pedestrians in a scene; run the same command again to resume."""

    scene: Positional[str] = ""
    """Scene bundle, "embedded", "embedded:SEED" or "embedded:plan-SEED"."""
    out: Path
    """Data folder for the shards."""
    episodes: int | None = None
    """Episodes to record; by default 100, or the number of entries in the scenario file."""
    workers: int = 1
    """Renderer processes, or driver processes with a policy, in addition to one process for each other role; 0
    does everything in this process."""
    seed: int = 0
    """Seed of the run."""
    people: MixName | None = None
    """Scenario mix: how many pedestrians there are and how they meet the robot; overrides `config`. "paper" by
    default."""
    policy: Path | None = None
    """Folder of a trained policy for DAgger: the policy or the expert drives, every sample has expert labels, and
    failed episodes are kept. The robot is the policy's unless `robot` or `config` names one."""
    outputs: str = ""
    """Images to record, separated by commas: rgb, depth, median_depth, alpha, mask, normal, such as
    rgb,depth,mask; only rgb by default."""
    robot: Path | None = None
    """robot.toml of a different robot."""
    config: Path | None = None
    """TOML file with sections of settings; `--SECTION.KEY VALUE` overrides it."""
    watch: bool = False
    """Show the run live on a web page, as `readygo monitor` does."""
    json: bool = False
    """Print the summary as JSON."""
    recording: RecordingOptions = field(default_factory=RecordingOptions)
    world: WorldOptions = field(default_factory=WorldOptions)
    fleet: FleetOptions = field(default_factory=FleetOptions)
    place: PlaceOptions = field(default_factory=PlaceOptions)
    observe: Observing = field(default_factory=Observing)
    keys: RunKeys = field(default_factory=dict)


def generate(options: GenerateOptions) -> None:
    """Record episodes of a robot among pedestrians in a scene; run the same command again to resume."""
    check_counts(1 if options.episodes is None else options.episodes, options.workers)
    _check_place(options)
    options.observe.check_installed()
    spec, wanted = _repeated_run(options) if options.recording.again else _new_run(options)
    _record(spec, wanted, options)


def _check_place(options: GenerateOptions) -> None:
    """Check that the options of workers and endpoints fit together.

    Raises:
        RunError: If some contradict each other.
        ConfigError: If an endpoint is malformed.
    """
    on, workers, fleet = options.place.on, options.workers, options.fleet
    for option, endpoint in (("--listen", fleet.listen), ("--connect", fleet.connect)):
        if endpoint:
            check_endpoint(endpoint, option)
    if on == "slurm":
        check_slurm(workers, fleet.listen)
    elif options.place.slurm:
        raise RunError("--slurm has options of sbatch: it goes with --on slurm.")
    elif on == "hosts":
        check_endpoints(fleet.listen, fleet.connect)
        if workers > 1:
            raise RunError(
                "--on hosts starts no workers: leave out --workers, and start `readygo worker` on each host."
            )
        if options.json:
            raise RunError("--on hosts has no summary for --json: leave it out, or ask `readygo status DATA --json`.")
    if fleet.connect and on != "hosts":
        raise RunError("--connect is for a run whose workers and recorders are on other machines: add --on hosts.")
    if options.watch and workers == 0 and on != "hosts":
        raise RunError("--watch needs a fleet to hear: give --workers 1 or more.")


def _repeated_run(options: GenerateOptions) -> tuple[RunSpec, int]:
    """The spec of the run that is recorded again, and its number of episodes."""
    assert options.recording.again is not None
    if given := given_options(options, _WITH_AGAIN):
        raise RunError(f"--again takes scene and settings from the recorded run: leave out {', '.join(given)}.")
    spec, wanted = prepare_again(options.recording.again, options.out)
    return with_run_keys(spec, options.keys), wanted


def _new_run(options: GenerateOptions) -> tuple[RunSpec, int]:
    """The spec of a run from the options, and its number of episodes."""
    recording, world = options.recording, options.world
    if not options.scene:
        raise RunError(NO_SCENE)
    if recording.mix is not None and options.policy is None:
        raise RunError("--mix is the share of a policy's episodes: name the policy with --policy.")
    trained = load_spec(options.policy) if options.policy else None
    outputs = [name.strip() for name in options.outputs.split(",")]
    config = load_run_config(
        options.config,
        load_robot(options.robot) if options.robot else None,
        world.sensor,
        options.people,
        base=robot_of_policy(trained) if trained else None,
        keys=merge_tables({"renderer": {"outputs": outputs}} if options.outputs else {}, options.keys),
    )
    spec = make_spec(
        open_scene(options.scene),
        avatars_of_policy(trained) if trained and not (world.avatars or recording.static) else world.avatars,
        config,
        seed=options.seed,
        split=Split(recording.split),
        static=recording.static,
        scenarios=world.scenarios,
    )
    if options.policy is not None:
        spec = with_policy(spec, config, options.policy, 0.5 if recording.mix is None else recording.mix)
    elif recording.teacher or config.driver.disturbed or "disturbed" in options.keys.get("driver", {}):
        spec = with_expert(spec)
    if recording.teacher is not None:
        spec = with_teacher(spec, config, recording.teacher)
    return spec, episode_count(world.scenarios) if options.episodes is None else options.episodes


def _record(spec: RunSpec, episodes: int, options: GenerateOptions) -> None:
    """Record a run, and print its progress and its summary."""
    out, fleet, strict = options.out, options.fleet, options.place.strict
    RunFolder(out).check(spec)
    endpoint = fleet.listen or fleet.connect
    state, role = RunFolder(out).state, spec.stages[-1].role
    join = how_to_join(state, role, endpoint, f" --run {spec.run}", certs=fleet.certs) if endpoint else ""
    page = show_page(out, (RunFolder(out).state / "endpoint").exists, fleet.certs) if options.watch else nullcontext()
    if options.place.on == "hosts":
        begin(spec, out, episodes)
        sys.stderr.write(f"{join}\n")
        with page:
            lead_run(RunFolder(out), fleet, strict=strict, observing=options.observe)
        return
    if options.observe.log_format == "json":
        begin_logging("json", run=spec.run, role=LAUNCHER, worker=LAUNCHER)
    with page, progress_bar(first_words=join, quiet=options.json) as show:
        summary = record(
            spec,
            out,
            episodes=episodes,
            workers=options.workers,
            listen=endpoint,
            slurm=options.place.slurm if options.place.on == "slurm" else None,
            certs=fleet.certs,
            show=show,
            observing=options.observe,
        )
    clarity = run_clarity(spec, out)
    if options.json:
        sys.stdout.write(json_module.dumps({**summary, "clarity": clarity.to_mapping()}) + "\n")
        report_set_aside(out, strict=strict)
        return
    console = PlainConsole(stderr=True, soft_wrap=True)
    console.print(
        f"{summary['episodes']:,} episodes, {summary['samples']:,} samples in {out} ({summary['wall_s']:.1f} s)."
    )
    for reason, count in summary["rejected"].items():
        console.print(f"  rejected {count}: {reason}", markup=False)
    for text in clarity.warnings():
        console.print(f"Warning: {text}", markup=False)
    report_set_aside(out, strict=strict)
    console.print(f"Next: readygo validate {out} && readygo train {out} --out policy", markup=False)
    console.print(f"What it covers: readygo coverage {out} --out coverage", markup=False)


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
