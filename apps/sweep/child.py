"""Child processes that end with their parent, also if it is killed, or with a node of a cluster."""

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

END_S = 20.0
"""Time for a child to end after SIGTERM before it is killed [s]."""
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)


def start_child(
    command: Sequence[str], *, stdout: IO[bytes] | None = None, stderr: IO[bytes] | None = None, cwd: Path | None = None
) -> "subprocess.Popen[bytes]":
    """Start a process that gets SIGTERM when the thread that started it ends; on Linux alone."""
    parent = os.getpid()

    def bind() -> None:
        if sys.platform == "linux":
            _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            os._exit(1)

    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, cwd=cwd, preexec_fn=bind)


def start_job(command: Sequence[str], log: Path, *, cwd: Path | None = None) -> "subprocess.Popen[bytes]":
    """Start the process of a point; what it prints is added to a log."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as stream:
        return start_child(command, stdout=stream, stderr=stream, cwd=cwd)


def end_child(child: "subprocess.Popen[bytes]") -> None:
    """End a process as Ctrl-C does, and wait for it."""
    with suppress(ProcessLookupError):
        child.terminate()
    try:
        child.wait(END_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
