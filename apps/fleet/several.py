"""A worker or a recorder of several runs: workers do one after the other, recorders take part in all at once."""

import gc
import logging
import threading
import time
from collections.abc import Callable
from functools import partial

from readygo.apps.fleet.runs import Runs
from readygo.common.errors import BusError, ReadygoError

log = logging.getLogger(__name__)

POLL_S = 0.2
"""How often it is looked for a run to take part in [s]."""
SILENT_S = 30.0
"""Time without a status of the named runs after which the worker gives up [s]."""
TakePart = Callable[[str, Callable[[], bool]], bool]
"""Takes part in a run until it is over or the callable says to leave; returns True if it is over."""


def work_for(runs: Runs, take_part: TakePart, stop: threading.Event) -> None:
    """Work on one run after the other, highest priority first, until `stop` or until all named runs are over.

    Raises:
        BusError: If no coordinator leads the named runs.
    """
    while not stop.is_set() and not runs.over:
        run = runs.choose()
        if not run:
            _check_heard(runs)
            stop.wait(POLL_S)
            continue
        log.info("works for %s", run)
        _take_part(runs, run, take_part, partial(_shall_leave, runs, run, stop))
        # Free the memory of this run's scene and avatars for the next run.
        gc.collect()


def record_for(runs: Runs, take_part: TakePart, stop: threading.Event) -> None:
    """Take part in all runs at the same time, until `stop` or until all named runs are over.

    Raises:
        BusError: If no coordinator leads the named runs.
    """
    threads: dict[str, threading.Thread] = {}
    while not stop.is_set() and not runs.over:
        for run in runs.open():
            if run not in threads or not threads[run].is_alive():
                log.info("records %s", run)
                threads[run] = threading.Thread(target=_take_part, args=(runs, run, take_part, stop.is_set), name=run)
                threads[run].start()
        if not any(thread.is_alive() for thread in threads.values()):
            _check_heard(runs)
        stop.wait(POLL_S)
    stop.set()
    for thread in threads.values():
        thread.join()


def _take_part(runs: Runs, run: str, take_part: TakePart, leave: Callable[[], bool]) -> None:
    """Take part in a run; after an error the run is ignored for a while, and the other runs continue."""
    try:
        over = take_part(run, leave)
    except ReadygoError as error:
        log.error("%s is left alone: %s", run, error)
        runs.bar(run)
    else:
        runs.left(run, over=over)


def _shall_leave(runs: Runs, run: str, stop: threading.Event) -> bool:
    return stop.is_set() or runs.better_than(run)


def _check_heard(runs: Runs) -> None:
    if runs.named and time.monotonic() - runs.heard_s > SILENT_S:
        raise BusError(f"No coordinator leads a run of {', '.join(sorted(runs.named))} there.")
