"""One background task at a time beside the main thread."""

import queue
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Generic, TypeVar

Result = TypeVar("Result")
END_S = 20.0
"""Longest wait for a task that is told to stop [s]."""


class StoppedError(Exception):
    """Raised in a task that is no longer needed."""


class Background(Generic[Result]):
    """Runs each task in a thread; a context that ends the task."""

    def __init__(self) -> None:
        self._done: queue.SimpleQueue[Result | BaseException] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> "Background[Result]":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._stop.set()
        if self._thread:
            self._thread.join(END_S)

    @property
    def busy(self) -> bool:
        """True while there is a task whose result was not taken."""
        return self._thread is not None

    def start(self, work: Callable[[Callable[[], None]], Result]) -> None:
        """Begin a task; it must call its argument periodically, which ends the task when the context ends."""
        assert not self.busy
        self._thread = threading.Thread(target=self._run, args=(work,), daemon=True)
        self._thread.start()

    def result(self) -> Result | None:
        """Take the result of the task; None before it is done, and after it was taken.

        Raises:
            BaseException: The exception that the task raised.
        """
        try:
            done = self._done.get_nowait()
        except queue.Empty:
            return None
        self._thread = None
        if isinstance(done, BaseException):
            raise done
        return done

    def _run(self, work: Callable[[Callable[[], None]], Result]) -> None:
        try:
            self._done.put(work(self._check))
        except StoppedError:
            pass  # The context has ended: nothing takes a result.
        except BaseException as error:  # The main thread raises it.
            self._done.put(error)

    def _check(self) -> None:
        if self._stop.is_set():
            raise StoppedError
