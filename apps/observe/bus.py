"""A bus whose requests are measured and traced."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Protocol, TypeVar

from readygo.common.bus import Bus, Member
from readygo.common.messages.topics import Live, Stream, Topic

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")


class Watcher(Protocol):
    """Observer of a process's requests."""

    def requesting(self, topic: str) -> AbstractContextManager[None]:
        """Context that is active while this process waits for the reply to a request."""
        ...

    def handling(self, topic: str) -> AbstractContextManager[None]:
        """Context that is active while this process handles a request."""
        ...


class WatchedBus:
    """A `readygo.common.bus.Bus` whose requests are observed; lossy streams are not."""

    def __init__(
        self, bus: Bus, watchers: tuple[Watcher, ...], answered: Callable[[str, Any, Any], None] | None = None
    ) -> None:
        """Take part in a run through another bus.

        Args:
            bus: The bus itself.
            watchers: Observers, the outermost first.
            answered: Called with topic, request and reply of every request that this process has handled.
        """
        self._bus, self._watchers, self._answered = bus, watchers, answered

    def serve(self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], **rights: Any) -> None:
        """Serve a topic with an observed handler; arguments as in `Bus.serve`."""

        def handle(request: Request) -> Reply:
            with ExitStack() as watched:
                for watcher in self._watchers:
                    watched.enter_context(watcher.handling(topic.name))
                reply = handler(request)
            if self._answered:
                self._answered(topic.name, request, reply)
            return reply

        self._bus.serve(topic, handle, **rights)

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """Send a request and wait for its reply, observed."""
        with ExitStack() as watched:
            for watcher in self._watchers:
                watched.enter_context(watcher.requesting(topic.name))
            return self._bus.request(topic, request, timeout_s=timeout_s)

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """Publish a message on a stream."""
        self._bus.publish(stream, message)

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Publish live data, which is made only if there is a subscriber."""
        self._bus.tell(live, make)

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """Subscribe to a stream."""
        self._bus.subscribe(stream, handler)

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """Announce this process; arguments as in `Bus.announce`."""
        return self._bus.announce(role, name, turn=turn, replaced=replaced)

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """Call `changed` when a process joins or leaves."""
        self._bus.watch(changed)

    def close(self) -> None:
        """Leave the run."""
        self._bus.close()
