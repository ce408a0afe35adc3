"""Points of a sweep as processes of this machine, a few at a time."""

import subprocess
import time
from collections.abc import Callable, Sequence

from readygo.apps.sweep.child import end_child, start_job
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import Sweep, SweepPoint
from readygo.apps.sweep.point import point_command

CHECK_S = 0.1
"""Time between looks at the processes [s]."""
Ended = Callable[[SweepPoint], None]


def run_here(folder: SweepFolder, sweep: Sweep, points: Sequence[SweepPoint], *, workers: int, ended: Ended) -> None:
    """Run points on this machine.

    Args:
        folder: The sweep's folder.
        sweep: The sweep.
        points: Points to run, in this order.
        workers: Points at a time.
        ended: Told about each point that ends.
    """
    plan, waiting = folder.keep_plan(sweep), list(points)
    running: dict[SweepPoint, subprocess.Popen[bytes]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                point = waiting.pop(0)
                command = point_command(plan, folder.path, str(point.index))
                running[point] = start_job(command, folder.log(point))
            for point in [point for point, child in running.items() if child.poll() is not None]:
                del running[point]
                ended(point)
            time.sleep(CHECK_S)
    finally:
        for child in running.values():
            child.terminate()
        for child in running.values():
            end_child(child)
