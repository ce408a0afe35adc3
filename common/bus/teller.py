"""What a participant shows of its work: made only while a subscriber listens, and not too often."""

import time
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from readygo.common.messages.topics import Live, Stream

Message = TypeVar("Message")


class Publisher(Protocol):
    """The part of a bus that publishes."""

    def heard(self, stream: Stream[Any]) -> bool:
        """True if a subscriber listens to a stream."""
        ...

    def publish(self, stream: Stream[Any], message: Any) -> None:
        """Give a message to the subscribers of a stream, and return at once."""
        ...


class Teller:
    """The streams of one participant."""

    def __init__(self, publisher: Publisher, clock: Callable[[], float] = time.monotonic) -> None:
        self._publisher, self._clock = publisher, clock
        self._told_s: dict[str, float] = {}
        self.me: tuple[str, str] | None = None
        """Role and name, once they are announced."""

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Publish what `make` gives on this participant's stream of a kind, as `Bus.tell` does."""
        if self.me is None:
            return
        now_s = self._clock()
        stream = live.of(*self.me)
        if now_s - self._told_s.get(live.kind, float("-inf")) < live.every_s or not self._publisher.heard(stream):
            return
        self._told_s[live.kind] = now_s
        self._publisher.publish(stream, make())
