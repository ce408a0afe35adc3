"""Points of a sweep as one job array of Slurm: a job per point."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from readygo.apps.fleet.slurm import call_slurm, one_thread_script, sbatch_options
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import PointNeeds, Sweep, SweepPoint
from readygo.apps.sweep.point import point_command

TASK = "$SLURM_ARRAY_TASK_ID"


def submit_array(
    folder: SweepFolder, sweep: Sweep, points: Sequence[SweepPoint], *, workers: int, needs: PointNeeds, options: str
) -> str:
    """Submit an array of a job per point, unless one of this sweep still waits or runs.

    Args:
        folder: The sweep's folder, at the same path on the nodes.
        sweep: The sweep.
        points: Points to run.
        workers: Most jobs at a time; 0 leaves it to Slurm.
        needs: Cores and GPUs of a job.
        options: Further options of sbatch.

    Returns:
        What was submitted, in words.

    Raises:
        RunError: If Slurm is not installed here, or rejects the array.
    """
    given, name = sbatch_options(options), f"readygo-sweep-{sweep.sha256[:12]}"
    if jobs := call_slurm("squeue", "--noheader", "--me", f"--name={name}", "--format=%A").split():
        return f"Slurm still has jobs of this sweep, {', '.join(dict.fromkeys(jobs))}: nothing is submitted."
    folder.logs.mkdir(parents=True, exist_ok=True)
    *command, _ = point_command(folder.keep_plan(sweep), folder.path.resolve(), TASK)
    throttle = f"%{workers}" if workers else ""
    job = call_slurm(
        "sbatch",
        "--parsable",
        f"--array={index_ranges([point.index for point in points])}{throttle}",
        "--requeue",
        "--open-mode=append",
        f"--cpus-per-task={needs.cpus}",
        *([f"--gpus-per-task={needs.gpus}"] if needs.gpus else []),
        f"--job-name={name}",
        f"--output={folder.logs.resolve()}/slurm-%A_%a.log",
        f"--chdir={Path.cwd()}",
        *given,
        "--wrap",
        f"{one_thread_script(command)} {TASK}",
    ).partition(";")[0]
    return f"Slurm job {job} has {len(points)} points."


def index_ranges(indices: Sequence[int]) -> str:
    """Increasing numbers as Slurm writes them: [0, 1, 2, 5] is "0-2,5"."""
    cuts = [0, *(k + 1 for k, (a, b) in enumerate(pairwise(indices)) if b != a + 1), len(indices)]
    runs = [(indices[begin], indices[end - 1]) for begin, end in pairwise(cuts)]
    return ",".join(str(low) if low == high else f"{low}-{high}" for low, high in runs)
