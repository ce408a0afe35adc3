"""Points of a sweep as tasks of an existing Ray cluster; alone in importing ray.

The nodes share a file system, and have this Python environment at the same path. A task runs the command of a point as
a process, so that nothing of Ray reaches into it.
"""

import logging
import os
import secrets
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from readygo.apps.fleet.slurm import ONE_THREAD
from readygo.apps.sweep.child import end_child, start_job
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import PointNeeds, Sweep, SweepPoint
from readygo.apps.sweep.point import point_command
from readygo.common.errors import ConfigError, RunError, first_line
from readygo.common.extras import install_command
from readygo.common.files import write_whole

RETRIES = 3
"""How often a point starts again when its node or Ray's worker dies."""
ANSWER_S = 5.0
Ended = Callable[[SweepPoint], None]


def run_on_ray(
    folder: SweepFolder,
    sweep: Sweep,
    points: Sequence[SweepPoint],
    *,
    address: str,
    workers: int,
    needs: PointNeeds,
    ended: Ended,
) -> None:
    """Run points on a Ray cluster.

    Args:
        folder: The sweep's folder, on a file system that the nodes share.
        sweep: The sweep.
        points: Points to run.
        address: Address of the cluster, "auto" for that of this machine.
        workers: Most points at a time; 0 leaves it to Ray.
        needs: Cores and GPUs of a task.
        ended: Told about each point that ends.

    Raises:
        ConfigError: If ray is not installed.
        RunError: If no cluster answers, a node does not see the folder, or a node died more often than `RETRIES`.
    """
    ray = import_ray()
    with _connected(ray, address), _token(folder) as token:
        run = ray.remote(num_cpus=needs.cpus, num_gpus=needs.gpus, max_retries=RETRIES)(run_command)
        plan, waiting = folder.keep_plan(sweep), list(points)
        running: dict[Any, SweepPoint] = {}
        while waiting or running:
            while waiting and len(running) < (workers or len(points)):
                point = waiting.pop(0)
                command = point_command(plan, folder.path.resolve(), str(point.index))
                running[run.remote(command, str(folder.log(point).resolve()), str(Path.cwd()), str(token))] = point
            (done, *_), _ = ray.wait(list(running), num_returns=1)
            try:
                blind = ray.get(done)
            except ray.exceptions.RayError as error:
                raise RunError(f"Ray cannot run the point {running[done].name}: {first_line(error)}") from error
            if blind:
                raise RunError(
                    f"The node {blind} does not see {folder.path.resolve()}: --out must be on a file system that all "
                    "nodes share, at the same path."
                )
            ended(running.pop(done))


def run_command(command: list[str], log: str, cwd: str, token: str) -> str:
    """Run a point in a task of Ray; the point keeps how it ends.

    Args:
        command: The command of the point.
        log: File that its messages are added to.
        cwd: Folder that its relative paths start from.
        token: A file in the sweep's folder.

    Returns:
        The name of this node if it does not see the sweep's folder, else nothing.
    """
    if not (Path(token).is_file() and Path(cwd).is_dir()):
        return socket.gethostname()
    # Ray sets the first of these to the task's cores; the other places have one thread, on which results may depend.
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    child = start_job(command, Path(log), cwd=Path(cwd))
    try:
        child.wait()
    finally:
        end_child(child)
    return ""


def import_ray() -> Any:
    """The module ray.

    Raises:
        ConfigError: If it is not installed.
    """
    try:
        import ray
        import ray.exceptions
    except ImportError as error:
        raise ConfigError(f"--on ray needs ray; run: {install_command('ray')}") from error
    return ray


@contextmanager
def _connected(ray: Any, address: str) -> Iterator[None]:
    """A connection to a cluster, which must be there: Ray would otherwise start one."""
    try:
        _check_answer(address)
        ray.init(address=address, logging_level=logging.ERROR, log_to_driver=False)
    except (OSError, ValueError, RuntimeError) as error:
        line = " ".join(str(error).split())[:200]
        raise RunError(f"No Ray cluster answers at {address!r}: {line}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _check_answer(address: str) -> None:
    """Raise OSError if nothing answers at HOST:PORT: Ray itself tries for minutes."""
    host, colon, port = address.rpartition(":")
    if colon and port.isdecimal() and "/" not in host:
        socket.create_connection((host, int(port)), timeout=ANSWER_S).close()


@contextmanager
def _token(folder: SweepFolder) -> Iterator[Path]:
    """A file in the sweep's folder, by which a task tells that its node sees the folder."""
    path = folder.state / f"token-{secrets.token_hex(8)}"
    write_whole(path, "", raises=RunError)
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
