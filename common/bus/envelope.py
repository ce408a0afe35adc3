"""What travels beside the message of a request: the name of its topic, and optionally the trace that it belongs to."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

TRACE: ContextVar[str] = ContextVar("trace", default="")
"""The trace that requests of this thread belong to, as W3C's traceparent; empty for none, and nothing travels then."""
_LENGTH_MAX = 64


def seal(topic: str) -> bytes:
    """The envelope of a request to `topic`, made on this thread."""
    trace = TRACE.get()
    return (f"{topic}\n{trace}" if trace else topic).encode()


@contextmanager
def opened(envelope: bytes) -> Iterator[str]:
    """Take up the trace of a request for as long as the block runs; gives the name of the topic that is meant."""
    topic, _, trace = envelope.decode(errors="replace").partition("\n")
    before = TRACE.set(trace if len(trace) <= _LENGTH_MAX else "")
    try:
        yield topic
    finally:
        TRACE.reset(before)
