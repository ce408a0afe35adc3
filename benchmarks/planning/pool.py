"""Draws the indices of jobs, in this process or in several; the numbers do not depend on how many."""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from itertools import count

from readygo.benchmarks.planning.runs import REJECTED_MAX, Course, Draw, PlanningJob
from readygo.common.errors import SceneError
from readygo.common.files import write_whole

_course: Course | None = None


def draw_index(job: PlanningJob, index: int) -> Draw:
    """Draw an index of a job; the process keeps the course for the next one."""
    global _course
    if _course is None or _course.job != job:
        _course = None  # Memory of the former map goes first.
        _course = Course(job)
    return _course.draw(index, pictured=job.pictures is not None)


Submit = Callable[[PlanningJob, int], "Future[Draw]"]


@contextmanager
def processes(process_count: int) -> Iterator[Submit]:
    """Processes that draw indices; one is this process itself.

    Raises:
        ValueError: If `process_count` is not positive.
    """
    if process_count < 1:
        raise ValueError(f"process_count must be positive, got {process_count}.")
    if process_count == 1:
        yield _drawn_here
        return
    with ProcessPoolExecutor(process_count, multiprocessing.get_context("spawn")) as pool:
        try:
            yield lambda job, index: pool.submit(draw_index, job, index)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _drawn_here(job: PlanningJob, index: int) -> "Future[Draw]":
    future: Future[Draw] = Future()
    try:
        future.set_result(draw_index(job, index))
    except Exception as error:  # Raised again when the caller asks for the result, as a pool does.
        future.set_exception(error)
    return future


def draws(job: PlanningJob, episodes: int, submit: Submit, ahead: int) -> Iterator[Draw]:
    """The draws of a job in the order of their indices, up to the one that completes `episodes` accepted ones.

    Args:
        job: What is run.
        episodes: Accepted indices that are wanted.
        submit: Begins to draw an index.
        ahead: Indices that are drawn at the same time; the result does not depend on it.

    Raises:
        SceneError: If REJECTED_MAX indices in a row have no episode.
    """
    indices, pending = count(), deque[Future[Draw]]()
    accepted = rejected_in_a_row = 0
    while accepted < episodes:
        while len(pending) < ahead:
            pending.append(submit(job, next(indices)))
        draw = pending.popleft().result()
        rejected_in_a_row = rejected_in_a_row + 1 if draw.rejected else 0
        accepted += not draw.rejected
        if rejected_in_a_row == REJECTED_MAX:
            raise SceneError(
                f"Map {job.source.name} has no room for episodes: {REJECTED_MAX} draws in a row were rejected, "
                f"the last one with {draw.rejected!r}."
            )
        # Only what counts has pictures: indices beyond are drawn ahead for speed.
        if job.pictures is not None:
            for name, png in draw.pictures.items():
                write_whole(job.pictures / name, png)
            draw.pictures.clear()
        yield draw
    for future in pending:
        future.cancel()
