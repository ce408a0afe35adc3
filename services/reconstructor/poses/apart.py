"""Calls in a separate process, for libraries that end the whole process when memory or the disk runs out."""

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from readygo.common.errors import RunError

T = TypeVar("T")


def apart(function: Callable[..., T], *args: Any, **kwargs: Any) -> T:
    """What a function of a module returns or raises; the process that calls it ends with this call, at Ctrl-C too.

    Raises:
        RunError: If the process died; with what it said first.
    """
    context = multiprocessing.get_context("spawn")
    with TemporaryDirectory() as folder:
        said = Path(folder) / "stderr"
        said.touch()
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_call, args=(theirs, str(said), function, args, kwargs), daemon=True)
        try:
            _start(process)
            theirs.close()
            error, value = ours.recv()
        except EOFError:
            process.join()
            words = next(iter(said.read_text(errors="replace").splitlines()), "it said nothing").strip()
            raise RunError(
                f"{function.__name__} ended the process that ran it ({_ending(process.exitcode)}), as when memory or "
                f"the disk runs out: {words}. Make room and run the same command again; finished stages stay."
            ) from None
        finally:
            if process.pid is not None:
                process.kill()
                process.join()
    if error is not None:
        raise error
    result: T = value
    return result


def _start(process: SpawnProcess) -> None:
    """Start a process that Ctrl-C does not reach: the calling process receives it, and ends the started one."""
    # Started later, the tracker would let signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _call(answer: Connection, said: str, function: Callable[..., Any], args: Any, kwargs: Any) -> None:
    os.dup2(os.open(said, os.O_WRONLY | os.O_APPEND), 2)
    try:
        value = function(*args, **kwargs)
    except Exception as error:
        answer.send((error, None))
    else:
        answer.send((None, value))


def _ending(code: int | None) -> str:
    if code is None or code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name
