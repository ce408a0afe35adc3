"""A policy on states that is trained by `readygo rl` in another process, while perception is."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from readygo.apps.learn.perceive_plan import SETTINGS_FILE, PerceivePlan, has_policy_on_states
from readygo.common.errors import RunError
from readygo.runs.methods import RL

RL_SHARE = 0.6
"""Share of the time that the policy on states is trained for, besides the drawing of its episodes and its lessons."""
RL_EPISODES, RL_LESSONS = (100, 6000), (50, 3000)
"""Episodes that it drives in, and those in which the expert teaches it first: per minute of the run, and at most."""


@contextmanager
def reinforcement(plan: PerceivePlan, lock: int) -> Iterator[Callable[..., None]]:
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
