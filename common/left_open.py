"""Sessions on networks that a process has not closed yet.

Python waits at its end for the threads that hear a session's messages, and they end with the session alone: a command
that is interrupted just before it closes one, or while it does, would never end.
"""

import logging
import weakref
from typing import Protocol

log = logging.getLogger(__name__)


class Closable(Protocol):
    """A session."""

    def close(self) -> None:
        """Leave the network; does nothing the second time."""


_OPEN: "weakref.WeakSet[Closable]" = weakref.WeakSet()


def note_open(session: Closable) -> None:
    """Have `close_all` close a session, unless it is gone by then."""
    _OPEN.add(session)


def close_all() -> None:
    """Close what is left open, as the last thing that a process does."""
    for session in tuple(_OPEN):
        try:
            session.close()
        except Exception:
            log.exception("%s cannot be closed", session)
    _OPEN.clear()
