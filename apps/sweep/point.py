"""Runs one point of a sweep: the same on this machine, in a job of Slurm, a pod and a task of Ray."""

import dataclasses
import socket
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from readygo.apps.cli import INTERRUPTED, TERMINATED
from readygo.apps.fleet.fleet import last_words
from readygo.apps.sweep.child import end_child, start_child
from readygo.apps.sweep.folder import PointRecord, SweepFolder
from readygo.apps.sweep.identity import point_sha256
from readygo.apps.sweep.plan import Sweep, SweepPoint
from readygo.common.documents import parse_json
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import MANIFEST_FILE, read_manifest
from readygo.runs.identity import sources_commit

PATIENCE_S = 60.0
"""Time for an earlier process of the point to end, for example on a lost node [s]."""
SAID_BEFORE = "readygo: "


def point_command(plan: Path, out: Path, index: str) -> list[str]:
    """The command that runs one point, in the same Python environment.

    Args:
        plan: The sweep's file.
        out: The sweep's folder.
        index: Number of the point, or the shell's name of a variable that has it.
    """
    return [sys.executable, "-m", "readygo", "sweep", str(plan), "--out", str(out), "--point", index]


def run_point(folder: SweepFolder, sweep: Sweep, index: int) -> PointRecord:
    """Run a point unless it is done, and keep how it ended.

    Args:
        folder: The sweep's folder.
        sweep: The sweep.
        index: Number of the point.

    Returns:
        The record, also of a point that failed.

    Raises:
        ReadygoError: If there is no such point, an input is missing, its folder holds another run, or another process
            runs it.
    """
    if not 0 <= index < len(sweep.points):
        raise RunError(f"--point must be 0..{len(sweep.points) - 1} in this sweep, got {index}.")
    point = sweep.points[index]
    with folder.lock(point, patience_s=PATIENCE_S) as held:
        if not held:
            raise RunError(f"Another process runs the point {point.name}.")
        sha256 = point_sha256(sweep, point)
        before = folder.record_of(point, sha256)
        if before is not None and before.state == "done":
            return before
        record = PointRecord(
            name=point.name,
            sha256=sha256,
            state="running",
            attempts=1 + (before.attempts if before else 0),
            commit=sources_commit(),
            host=socket.gethostname(),
        )
        folder.write(point, record)
        return _run(folder, sweep, point, record)


def _run(folder: SweepFolder, sweep: Sweep, point: SweepPoint, record: PointRecord) -> PointRecord:
    command = [sys.executable, "-m", "readygo", *sweep.arguments(point, folder.out(point))]
    folder.out(point).parent.mkdir(parents=True, exist_ok=True)
    begin_s = time.monotonic()
    with ExitStack() as files:
        stdout = files.enter_context(folder.output(point).open("wb"))
        stderr = files.enter_context(folder.log(point).open("ab"))
        child = start_child(command, stdout=stdout, stderr=stderr)
        try:
            code = child.wait()
        except BaseException:
            end_child(child)
            folder.write(point, dataclasses.replace(record, state="interrupted"))
            raise
    ended = dataclasses.replace(record, exit_code=code, wall_s=round(time.monotonic() - begin_s, 2))
    if code in (INTERRUPTED, TERMINATED):
        ended = dataclasses.replace(ended, state="interrupted")
    elif code:
        ended = dataclasses.replace(ended, state="failed", reason=_reason(folder.log(point), code))
    else:
        ended = dataclasses.replace(ended, state="done", result=_result(folder, sweep, point))
    folder.write(point, ended)
    return ended


def _reason(log: Path, code: int) -> str:
    """Why a command failed, in one line."""
    if code < 0:
        return f"it was ended by signal {-code}."
    return last_words(log).removeprefix(SAID_BEFORE)


def _result(folder: SweepFolder, sweep: Sweep, point: SweepPoint) -> Any:
    """What a command that ended well has measured, as plain values."""
    if (folder.out(point) / MANIFEST_FILE).exists():
        return {"scores": read_manifest(folder.out(point)).scores}
    lines = folder.output(point).read_bytes().strip().splitlines()
    try:
        return parse_json(lines[-1]) if lines else None
    except ValueError:
        return None
