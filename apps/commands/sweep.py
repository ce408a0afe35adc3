"""`readygo sweep`: arms x scenes x seeds of a command, on this machine, Slurm, Kubernetes or Ray."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from readygo.apps.cli import USER_MISTAKE
from readygo.apps.fleet.fleet import last_words
from readygo.apps.fleet.slurm import sbatch_options
from readygo.apps.sweep.array import submit_array
from readygo.apps.sweep.folder import JOINED_FILE, PointRecord, SweepFolder
from readygo.apps.sweep.identity import point_sha256
from readygo.apps.sweep.kubernetes import PodOptions, job_manifest
from readygo.apps.sweep.local import run_here
from readygo.apps.sweep.plan import PointNeeds, Sweep, SweepPoint, open_sweep
from readygo.apps.sweep.point import run_point
from readygo.apps.sweep.ray_tasks import import_ray, run_on_ray
from readygo.apps.sweep.results import MARKDOWN_FILE, PAGE_FILE, join_results
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import RunError
from readygo.common.files import write_whole

SOME_FAILED = 1
"""Exit status of `--point` if its command crashed: Slurm and Kubernetes may start it again."""
AUTO = "auto"
SweepPlace = Literal["local", "slurm", "kubernetes", "ray"]


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """Run a command with every arm in every scene with every seed; the same command resumes, and retries what failed.

    SWEEP is a TOML file: command, scenes, seeds, [options] of all points, [arms.NAME] of each arm. A point is one job,
    and writes into OUT/ARM/SCENE/SEED. OUT/sweep.html, sweep.md and sweep.json have the means over the seeds.
    """

    sweep: Positional[Path]
    """TOML file of the sweep."""
    out: Path
    """Folder of the sweep, new or to resume."""
    on: SweepPlace = "local"
    """Where points run. "local": on this machine. "slurm": submits a job array; call again for the results.
    "kubernetes": prints the manifest of an Indexed Job, or writes `manifest`. "ray": as tasks on a running cluster."""
    workers: int = 0
    """Points at a time; 0 is 1 on this machine, and no limit elsewhere."""
    cpus: int = 1
    """Cores of a point, which Slurm, Kubernetes and Ray reserve."""
    gpus: int = 0
    """GPUs of a point, likewise."""
    slurm: str = ""
    """Options of sbatch, such as "--partition=short --time=2:00:00"."""
    ray_address: str = AUTO
    """Address of the Ray cluster; "auto" is the one that this machine belongs to."""
    manifest: Path | None = None
    """File to write the manifest of Kubernetes to."""
    point: int | None = None
    """Run this point alone, by its number from 0, as jobs of a cluster do."""
    json: bool = False
    """Print sweep.json instead of the table."""
    pods: PodOptions = field(default_factory=PodOptions)


def sweep(options: SweepOptions) -> None:
    """Run a command with every arm in every scene with every seed; the same command resumes, and retries failures."""
    _check(options)
    plan, folder = open_sweep(options.sweep), SweepFolder(path=options.out)
    if options.on == "kubernetes":
        _write_manifest(options, plan)
        return
    folder.check_free()
    if options.point is not None:
        _run_alone(folder, plan, options.point)
        return
    waiting = _unfinished(folder, plan)
    if waiting:
        _check_place(options)
        with _kept(folder):
            _launch(options, folder, plan, waiting)
    records = join_results(folder, plan)
    _tell(options, folder, records)
    left = len(plan.points) - sum(record.state == "done" for record in records)
    if left and options.on != "slurm":
        raise RunError(
            f"{left} of {len(plan.points)} points are not done; the same command runs them again. Their logs lie in "
            f"{folder.points}."
        )


def _check(options: SweepOptions) -> None:
    """Raise RunError for options that do not go together."""
    for flag, value, least in (
        ("--workers", options.workers, 0),
        ("--cpus", options.cpus, 1),
        ("--gpus", options.gpus, 0),
    ):
        if value < least:
            raise RunError(f"{flag} must be at least {least}, got {value}.")
    given = {
        "slurm": ("--slurm", options.slurm != ""),
        "ray": ("--ray-address", options.ray_address != AUTO),
        "kubernetes": ("--manifest", options.manifest is not None),
    }
    for place, (flag, is_given) in given.items():
        if is_given and options.on != place:
            raise RunError(f"{flag} has no effect without --on {place}.")
    if options.point is not None and options.on != "local":
        raise RunError("--point runs here: leave --on out.")


def _check_place(options: SweepOptions) -> None:
    """Check that the place is there before anything is written."""
    if options.on == "slurm":
        sbatch_options(options.slurm)
    elif options.on == "ray":
        import_ray()


def _unfinished(folder: SweepFolder, plan: Sweep) -> list[SweepPoint]:
    """Points that are not done.

    Raises:
        ReadygoError: If an input is missing, or a point's folder holds another run.
    """
    records = [(point, folder.record_of(point, point_sha256(plan, point))) for point in plan.points]
    return [point for point, record in records if record is None or record.state != "done"]


def _launch(options: SweepOptions, folder: SweepFolder, plan: Sweep, points: Sequence[SweepPoint]) -> None:
    console, needs = PlainConsole(stderr=True, soft_wrap=True), _needs(options)

    def ended(point: SweepPoint) -> None:
        console.print(_ending(folder, point))

    if options.on == "slurm":
        said = submit_array(folder, plan, points, workers=options.workers, needs=needs, options=options.slurm)
        console.print(f"{said} Run the same command again for the results, and for what is left.")
    elif options.on == "ray":
        address = options.ray_address
        run_on_ray(folder, plan, points, address=address, workers=options.workers, needs=needs, ended=ended)
    else:
        run_here(folder, plan, points, workers=options.workers or 1, ended=ended)


def _needs(options: SweepOptions) -> PointNeeds:
    return PointNeeds(cpus=options.cpus, gpus=options.gpus)


def _run_alone(folder: SweepFolder, plan: Sweep, index: int) -> None:
    """Run one point, and exit as a scheduler needs it: with 2 for a mistake that no retry helps, 1 for a crash."""
    with _kept(folder):
        record = run_point(folder, plan, index)
    join_results(folder, plan)
    if record.state == "done":
        PlainConsole(soft_wrap=True).print(f"{record.name} is done.")
    elif record.exit_code == USER_MISTAKE:
        raise RunError(record.reason)
    else:
        sys.stderr.write(f"readygo: {record.name} {record.state}: {record.reason}\n")
        raise SystemExit(SOME_FAILED)


def _ending(folder: SweepFolder, point: SweepPoint) -> str:
    """How a point ended, in one line."""
    record = folder.record(point)
    if record is not None and record.state == "done":
        return f"{point.name}: done in {record.wall_s:.0f} s"
    failed = record is not None and record.state == "failed"
    reason = record.reason if record is not None and failed else last_words(folder.log(point))
    return f"{point.name}: {'failed' if failed else 'ended early'}: {reason}"


def _write_manifest(options: SweepOptions, plan: Sweep) -> None:
    text = job_manifest(plan, str(options.out), options.pods, workers=options.workers, needs=_needs(options))
    if options.manifest is None:
        sys.stdout.write(text)
        return
    write_whole(options.manifest, text, raises=RunError)
    console = PlainConsole(soft_wrap=True)
    console.print(f"{len(plan.points)} points. Run them: kubectl apply -f {options.manifest}")


def _tell(options: SweepOptions, folder: SweepFolder, records: Sequence[PointRecord]) -> None:
    if options.json:
        sys.stdout.write((folder.path / JOINED_FILE).read_text())
        return
    console = PlainConsole(soft_wrap=True)
    if any(record.state == "done" for record in records):
        console.print((folder.path / MARKDOWN_FILE).read_text())
        console.print(f"Look at it: {folder.path / PAGE_FILE}")


@contextmanager
def _kept(folder: SweepFolder) -> Iterator[None]:
    """At Ctrl-C, say that the points are kept."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"what ended is kept in {folder.path}; the same command resumes.") from None
