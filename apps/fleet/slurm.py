"""Workers of a fleet as an array of Slurm jobs.

Slurm starts, stops and requeues them; the coordinator gives unfinished work of an ended one to others. Each node needs
this Python environment at the same path. Workers fetch the scene and avatars that their node lacks.
"""

import logging
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import readygo
from readygo.apps.fleet.fleet import RESTARTS_MAX, last_words
from readygo.apps.fleet.token import with_token
from readygo.common.bus.identity import ALL
from readygo.common.errors import RunError

CHECK_S = 5.0
"""Period of asking Slurm for the number of workers [s]."""
UNANSWERED_MAX_S = 600.0
"""Time without an answer of Slurm after which the run ends [s]: its controller restarts within minutes."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")

log = logging.getLogger(__name__)


class SlurmWorkers:
    """Workers of one run that do all its stages, as one job array; a context that cancels them at its end."""

    def __init__(
        self, *, connect: str, run: str, logs: Path, options: str = "", token: str = "", certs: Path | None = None
    ) -> None:
        """Prepare the array without submitting it.

        Args:
            connect: Endpoint of the fleet's router, as the nodes reach it.
            run: Name of the run.
            logs: Folder of the workers' logs, on a file system that the nodes share.
            options: Further options of sbatch, such as "--partition=short --time=2:00:00".
            token: The run's token; it goes to the jobs in their environment, which sbatch passes on.
            certs: Folder of certificates, at the same path on the nodes.

        Raises:
            RunError: If Slurm is not installed here, or `options` cannot be split.
        """
        self._options = sbatch_options(options)
        self._connect, self._run, self._logs = connect, run, logs
        self._shown = ["--certs", str(certs.resolve())] if certs else []
        self._environment = with_token(token)
        self._jobs: list[str] = []
        self._workers = 0
        self._checked_s = 0.0
        self._unanswered_s: float | None = None
        """Time since which Slurm has not answered [s]; None while it answers."""

    def __enter__(self) -> "SlurmWorkers":
        return self

    def __exit__(self, *_: object) -> None:
        self.cancel()

    def submit(self, workers: int) -> None:
        """Submit an array of `workers` jobs.

        Raises:
            RunError: If Slurm rejects it, with Slurm's message.
        """
        self._workers, self._checked_s = workers, time.monotonic()
        self._logs.mkdir(parents=True, exist_ok=True)
        arguments = ["--parsable", f"--array=0-{workers - 1}", "--requeue", "--open-mode=append", "--cpus-per-task=1"]
        arguments += [f"--job-name=readygo-{self._run}", f"--output={self._logs.resolve()}/slurm-%A_%a.log"]
        arguments += [f"--chdir={Path(readygo.__file__).resolve().parents[1]}"]
        arguments += [*self._options, "--wrap", self._script()]
        self._jobs.append(call_slurm("sbatch", *arguments, environment=self._environment).partition(";")[0])

    def check(self) -> None:
        """Submit the array again if no job waits or runs; call it only while the run is not over.

        While Slurm does not answer, its workers count as running.

        Raises:
            RunError: If the jobs end repeatedly, or Slurm does not answer for `UNANSWERED_MAX_S`.
        """
        if time.monotonic() - self._checked_s < CHECK_S:
            return
        self._checked_s = time.monotonic()
        try:
            left = call_slurm("squeue", "--noheader", "--me", f"--name=readygo-{self._run}", "--format=%T")
            again = not left and len(self._jobs) <= RESTARTS_MAX
            if again:
                self.submit(self._workers)
        except RunError as error:
            self._note_unanswered(error)
            return
        self._unanswered_s = None
        if not left and not again:
            raise RunError(f"All workers of Slurm job {self._jobs[-1]} ended: {self._last_words()}")

    def _note_unanswered(self, error: RunError) -> None:
        """Tolerate a Slurm that does not answer, up to `UNANSWERED_MAX_S`."""
        now_s = time.monotonic()
        if self._unanswered_s is None:
            self._unanswered_s = now_s
            log.warning("%s; the run waits %g min for Slurm, its workers continue.", error, UNANSWERED_MAX_S / 60.0)
        elif now_s - self._unanswered_s > UNANSWERED_MAX_S:
            minutes = f"{UNANSWERED_MAX_S / 60.0:g} min"
            raise RunError(f"{error}; so for {minutes}: run the same command again when Slurm answers.") from error

    def cancel(self) -> None:
        """Cancel all jobs; other workers, or a later call of the same command, do their unfinished work."""
        if self._jobs:
            subprocess.run(["scancel", *self._jobs], check=False, capture_output=True)

    def _script(self) -> str:
        """Batch script of a node: starts a worker with a unique name."""
        name = "slurm-$SLURM_ARRAY_JOB_ID-$SLURM_ARRAY_TASK_ID-${SLURM_RESTART_COUNT:-0}"
        command = [sys.executable, "-m", "readygo", "worker", ALL, "--connect", self._connect, "--run", self._run]
        command += self._shown
        return f"{one_thread_script(command)} --name {name}"

    def _last_words(self) -> str:
        logs = sorted(self._logs.glob(f"slurm-{self._jobs[-1]}_*.log"))
        return last_words(logs[-1]) if logs else "they left no log."


def sbatch_options(options: str) -> list[str]:
    """The user's options of sbatch as words.

    Raises:
        RunError: If Slurm is not installed here, or `options` cannot be split.
    """
    if shutil.which("sbatch") is None:
        raise RunError("--on slurm needs sbatch, squeue and scancel on this machine; they are not on the PATH.")
    try:
        return shlex.split(options)
    except ValueError as error:
        raise RunError(f"--slurm {options!r} cannot be split into options: {error}.") from error


def one_thread_script(command: Sequence[str]) -> str:
    """Batch script of a job that runs a command whose libraries use one thread each."""
    settings = " ".join(f"{variable}=1" for variable in ONE_THREAD)
    return f"exec env {settings} {shlex.join(command)}"


def call_slurm(command: str, *arguments: str, environment: Mapping[str, str] | None = None) -> str:
    """Run a command of Slurm, and return its output.

    Raises:
        RunError: If the command fails.
    """
    try:
        done = subprocess.run(
            [command, *arguments], check=True, capture_output=True, text=True, timeout=60, env=environment
        )
    except (OSError, subprocess.SubprocessError) as error:
        words = (getattr(error, "stderr", None) or str(error)).strip().splitlines()[-1:]
        raise RunError(f"Slurm: {' '.join(words) or 'no answer'}") from error
    return done.stdout.strip()


def check_slurm(workers: int, listen: str) -> None:
    """Check the options of a run on Slurm before anything is submitted.

    Raises:
        RunError: Without workers, or without an endpoint that nodes can reach.
    """
    if workers < 1:
        raise RunError("--on slurm needs --workers of at least 1.")
    if not listen:
        raise RunError(
            "--on slurm needs --listen with an address of this machine that Slurm's nodes reach, "
            "such as tcp/10.0.0.5:7447."
        )
