"""What has arrived at a bus and waits for its one thread."""

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

log = logging.getLogger(__name__)

INBOX_MAX = 16
"""Messages of one subscription that wait at most; the oldest make room."""
_CLOSE_S = 5.0


class Inbox:
    """Jobs that one thread does in order of arrival; the thread begins with the first job."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="bus", daemon=True)
        self._lock = threading.Lock()

    def put(self, job: Callable[[], None]) -> None:
        """Have a job done; one that fails is logged and costs the others nothing."""
        self._jobs.put(job)
        with self._lock:
            if self._thread.ident is None:
                self._thread.start()

    def close(self) -> None:
        """Wait until the jobs at hand are done."""
        self._jobs.put(None)
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=_CLOSE_S)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception:
                log.exception("a handler failed")


class Mailbox(Generic[Item]):
    """The newest messages of one subscription."""

    def __init__(self, inbox: Inbox, handler: Callable[[Item], None]) -> None:
        self._inbox = inbox
        self._handler = handler
        self._waiting: deque[Item] = deque(maxlen=INBOX_MAX)
        self._lock = threading.Lock()

    def put(self, item: Item) -> None:
        """Leave a message for the handler; never waits for it."""
        with self._lock:
            self._waiting.append(item)
            if len(self._waiting) == 1:
                self._inbox.put(self._take)

    def _take(self) -> None:
        with self._lock:
            item = self._waiting.popleft()
            if self._waiting:
                # Behind what has come meanwhile: a busy stream does not keep requests waiting.
                self._inbox.put(self._take)
        self._handler(item)
